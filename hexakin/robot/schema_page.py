"""The documentation of the robot file and an example file, both generated from the fields in ``schema``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

import yaml
from pydantic.fields import FieldInfo

from hexakin.robot.schema import Fields, RobotFields

_INTRODUCTION = """\
A robot is a YAML file with these fields. A field is required unless a line "Without it" says what is assumed.

Units are kg, m, rad, s and units derived from them. Numbers of a key that ends in _mm or _deg are converted. Angles may
be multiples of pi, such as -pi/2. Any value may be written as {value: ..., source: "Table 2"}; a source in a mapping
holds for all values below it. A field that is not listed here, or is given twice, is an error.

python -m hexakin robot FILE checks a file; hexakin.load_robot(FILE) loads it."""


def page() -> str:
    """Return the page that ``python -m hexakin robot --schema`` prints: every field, then an example file."""
    fields = "\n".join(_lines(RobotFields, "", {}))
    example_file = yaml.safe_dump(example(), sort_keys=False, default_flow_style=None, width=100)
    return f"{_INTRODUCTION}\n\n{fields}\n\nAn example, which loads as it is:\n\n{example_file}"


def example(model: type[Fields] = RobotFields) -> dict[str, Any]:
    """Return an example file as nested dicts and lists, for the group of fields ``model``.

    It has the required fields, and the optional fields with values for all legs.
    """
    tree: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        inner = _model(field)
        if field.is_required() or name in ("joint_limits", "standing", "parameters"):
            tree[name] = example(inner) if inner is not None and field.examples == [None] else _example(field)
    return tree


def paths(model: type[Fields] = RobotFields, path: str = "") -> dict[str, FieldInfo]:
    """Return every field of ``model`` by its path; ``path`` is a prefix.

    Fields of the items of a list have the path ``<path>.1``.
    """
    found = {}
    for name, field in model.model_fields.items():
        found[f"{path}{name}"] = field
        inner = _model(field)
        if inner is not None:
            found |= paths(inner, f"{path}{name}.1." if _is_list(field) else f"{path}{name}.")
    return found


def _lines(model: type[Fields], path: str, described: dict[type[Fields], str]) -> Iterator[str]:
    for name, field in model.model_fields.items():
        extra: Any = field.json_schema_extra or {}
        bounds, inner, where = extra.get("bounds"), _model(field), f"{path}{name}"
        yield f"{where} [{bounds.unit}]" if bounds else where
        yield f"    {field.description}"
        if bounds:
            yield f"    From {bounds.low:g} to {bounds.high:g} ({bounds.why})."
        if extra.get("assumed"):
            yield f"    Without it: {extra['assumed']}."
        if field.examples != [None]:
            yield f"    Example: {_inline(_example(field))}"
        if inner in described:
            yield f"    Fields as in {described[inner]}."
        elif inner is not None:
            described[inner] = where
            yield f"    {inner.__doc__}"
            yield from _lines(inner, f"{where}.1." if _is_list(field) else f"{where}.", described)


def _inline(value: Any) -> str:
    if isinstance(value, list) and value and isinstance(value[0], dict):
        value = value[0]  # one item of the list is enough as an example
    return yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10_000).strip().removesuffix("\n...")


def _example(field: FieldInfo) -> Any:
    return (field.examples or [None])[0]


def _is_list(field: FieldInfo) -> bool:
    return getattr(field.annotation, "__origin__", None) is list


def _model(field: FieldInfo) -> type[Fields] | None:
    """Return the model of the fields inside a field, or inside each item of its list; None if there is none."""
    for kind in (field.annotation, *get_args(field.annotation)):
        if isinstance(kind, type) and issubclass(kind, Fields):
            return kind
    return None
