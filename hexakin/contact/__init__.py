"""Contact mechanics: Coulomb friction with the exact cone or with paper A's polyhedron (A section 3.1)."""

from hexakin.contact.problem import ContactProblem, ContactSolution, Residuals, solve

__all__ = ["ContactProblem", "ContactSolution", "Residuals", "solve"]
