"""Studies: many independent runs in parallel, which can be interrupted and continued, with one table of results.

This package does not import any code about robots.
"""

from hexakin.exceptions import StudyError
from hexakin.study.runner import Study, fault, grid, run

__all__ = ["Study", "StudyError", "fault", "grid", "run"]
