"""Contact mechanics: Coulomb friction with the exact cone and with the paper's polyhedron (A section 3.1)."""
