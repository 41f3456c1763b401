"""All notebooks as one HTML report: ``python -m hexakin.report``."""

INSTALL = "pip install ipykernel jinja2 latex2mathml nbclient nbconvert"
"""The command that installs what the report needs besides hexakin."""
