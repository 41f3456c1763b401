"""One line for an object whose fields are long arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def short_repr(value: DataclassInstance) -> str:
    """Return the fields of a dataclass in one line, with the shapes of arrays and the names of entries.

    It serves as the ``__repr__`` of classes with long arrays: ``Motion(time (200,), q (200, 6, 3), touch 1e-06)``.
    """
    parts = [f"{part.name} {_short(getattr(value, part.name))}" for part in fields(value)]
    return f"{type(value).__name__}({', '.join(parts)})"


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return str(value.shape)
    if isinstance(value, Mapping):
        return "{" + ", ".join(map(str, value)) + "}"
    return repr(value)
