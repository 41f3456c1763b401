"""All notebooks as one HTML report: ``python -m hexakin.report``."""
