"""Experiments of the two papers for the notebooks: scenarios, studies, statements and verdicts."""
