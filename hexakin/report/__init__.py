"""Notebooks as one browsable report: ``python -m hexakin.report``."""
