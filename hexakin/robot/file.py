"""Read robot descriptions: YAML files with units in the field names and a source beside each value.

Any value in the file may be written as ``{value: ..., source: "Table 2"}``; a ``source`` in a mapping is the source of
all values in it that have no source of their own. Fields whose names end in ``_mm`` or ``_deg`` are converted to metres
and radians, and angles may be written as multiples of pi (``-pi/2``).
"""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from pydantic import ValidationError

from hexakin.checks import check_path, checked
from hexakin.checks.files import DEEPEST, read_bytes
from hexakin.exceptions import FileError, RobotFileError, UnknownNameError
from hexakin.installation import DATA
from hexakin.robot.build import build
from hexakin.robot.model import Robot
from hexakin.robot.schema import FieldError, RobotFields

_LARGEST = 64 * 1024  # [bytes] ten times the largest shipped file


def robot_names() -> list[str]:
    """Return the names of the shipped robots."""
    return sorted(path.stem for path in (DATA / "robots").glob("*.yaml"))


@checked
def load_robot(name: str | os.PathLike[str]) -> Robot:
    """Load a robot by its name or from a file.

    ``name`` is the name of a shipped robot (such as ``"athena"``) or the path of a YAML file. ``python -m hexakin robot
    --schema`` prints the documentation of such a file. Raises InvalidInputError if ``name`` is neither text nor a path,
    and UnknownNameError for an unknown name. Raises RobotFileError if the file cannot be read or describes a robot that
    cannot exist; the error names the file, the field, its value and the expected values.
    """
    path = check_path("name", name)
    if path.suffix not in (".yaml", ".yml") and path.name == str(path):
        if str(path) not in robot_names():
            raise UnknownNameError("robot", str(path), [*robot_names(), "a path to a .yaml file"])
        path = DATA / "robots" / f"{path}.yaml"
    return robot_from_tree(_parsed(_text(path), str(path)), str(path))


def robot_from_tree(tree: object, origin: str) -> Robot:
    """Build a robot from ``tree``, the nested dicts and lists of its file.

    ``origin`` is the file's name in error messages. Raises RobotFileError like ``load_robot``. ``tree`` is not changed.
    """
    if not isinstance(tree, dict):
        raise RobotFileError(f"{origin}: expected a mapping of fields, got {type(tree).__name__}")
    keys = _Keys({}, {})
    try:
        return build(RobotFields.model_validate(_strip(tree, "", "", keys)), *keys)
    except ValidationError as error:
        messages = "; ".join(_describe(item, keys) for item in error.errors()[:5])
        raise RobotFileError(f"{origin}: {messages}") from error
    except FieldError as error:
        raise RobotFileError(f"{origin}: {_short(error, 1000)}") from error
    except RecursionError as error:
        raise RobotFileError(f"{origin}: nested too deeply") from error


def _text(path: Path) -> str:
    try:
        return read_bytes(path, _LARGEST).decode("utf-8-sig")
    except FileError as error:
        raise RobotFileError(str(error)) from error
    except UnicodeDecodeError as error:
        raise RobotFileError(f"{path}: not text in UTF-8 ({error})") from error


# The errors that PyYAML raises for malformed text and invalid tags.
_YAML_FAULTS = (yaml.YAMLError, ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError)

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # PyYAML's C loader is about ten times as fast


def _parsed(text: str, origin: str) -> object:
    try:
        depth = 0
        for event in yaml.parse(text, Loader=_Loader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            fault = "aliases (*) are not allowed" if isinstance(event, yaml.AliasEvent) else "nested too deeply"
            if depth > DEEPEST or isinstance(event, yaml.AliasEvent):
                mark: Any = event.start_mark
                raise yaml.composer.ComposerError(None, None, fault, mark)
        return yaml.load(text, Loader=_StrictLoader)
    except _YAML_FAULTS as error:
        raise RobotFileError(f"{origin}: not valid YAML ({_short(error)})") from error


class _StrictLoader(_Loader):
    """A YAML loader that rejects fields given twice and keys that are not text."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(None, None, "a field's name must be text", key.start_mark)
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"field {key.value!r} is given twice", key.start_mark
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _short(value: object, most: int = 200) -> str:
    """Return the text of a value, short enough for a message."""
    try:
        text = str(value)
    except (ValueError, RecursionError):  # Python refuses to print an integer of thousands of digits
        text = f"a huge {type(value).__name__}"
    return text if len(text) <= most else text[:most] + " ..."


class _Keys(NamedTuple):
    """Sources of the values, and keys as written in the file (with the unit), by the path of each field."""

    sources: dict[str, str]
    written: dict[str, str]


_EXPONENT = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)[eE][+-]?\d+")
_UNITS = {"_mm": 1e-3, "_deg": math.pi / 180.0}


def _strip(node: Any, path: str, source: str, keys: _Keys) -> Any:
    """Remove ``value``/``source`` wrappers and unit suffixes, and store the source of each value in ``keys``."""
    if isinstance(node, dict):
        source = node.get("source", source)
        if not isinstance(source, str):
            raise FieldError(f"{path}source: expected text, got {_short(source)!r}")
        if "value" in node and set(node) <= {"value", "source"}:
            return _strip(node["value"], path, source, keys)
        result: dict[str, Any] = {}
        for key, child in node.items():
            if key == "source":
                continue
            name, factor = _short(key), 1.0
            for suffix, unit in _UNITS.items():
                if name.endswith(suffix):
                    name, factor = name.removesuffix(suffix), unit
            if name in result:
                raise FieldError(f"{path}{name}: given twice, in different units")
            keys.written[f"{path}{name}"] = str(key)
            value = _strip(child, f"{path}{name}.", source, keys)
            result[name] = _scaled(value, factor, f"{path}{key}") if factor != 1.0 else value
        return result
    if isinstance(node, list) and any(isinstance(child, (dict, list)) for child in node):
        return [_strip(child, f"{path}{i + 1}.", source, keys) for i, child in enumerate(node)]
    keys.sources[path.removesuffix(".")] = source
    # A YAML 1.1 loader reads a number without a dot, such as 1e-3, as text.
    return float(node) if isinstance(node, str) and _EXPONENT.fullmatch(node) else node


def _scaled(value: Any, factor: float, path: str) -> Any:
    if isinstance(value, list):
        return [_scaled(item, factor, path) for item in value]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise FieldError(f"{path}: expected a number, got {_short(value)!r}")
    try:
        return float(value) * factor
    except OverflowError as error:
        raise FieldError(f"{path}: number too large") from error


def _describe(item: Any, keys: _Keys) -> str:
    location = ".".join(str(part + 1) if isinstance(part, int) else _short(part) for part in item["loc"]) or "file"
    given = item["input"]
    if item["type"] == "bounds":
        about = item["ctx"]
        location += about["at"]
        key = keys.written.get(location, location.rpartition(".")[2])
        return f"{location}: {item['msg']}; {about['bounds'].hint(key, about['value'])}"
    shown = "" if item["type"] == "missing" or isinstance(given, dict) else f", got {_short(given)!r}"
    return f"{location}: {item['msg'].removeprefix('Value error, ')}{shown}"
