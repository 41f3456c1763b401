"""Studies: many independent runs, in parallel and resumable, in one tidy table. It knows no robot."""

from hexakin.exceptions import StudyError
from hexakin.study.runner import Study, fault, grid, run

__all__ = ["Study", "StudyError", "fault", "grid", "run"]
