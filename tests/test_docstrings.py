"""Every public name says what it takes, in which shape and unit, and what it raises."""

import ast
import dataclasses
import inspect
import itertools
import re
import textwrap

import pytest
from public_objects import public_objects

from hexakin import exceptions, installation

ERRORS = {name for name, value in vars(exceptions).items() if isinstance(value, type)} - {"HexakinError"}
ARRAYS = re.compile(r"\b(Array|ArrayLike|NDArray|ndarray)\b")
SHAPE = re.compile(r"\((?:\.\.\.|[A-Za-z0-9_+* ]+)(?:, ?[A-Za-z0-9_+*. ]+)*,?\)")
UNIT = re.compile(
    r"\[[^\]]+\]|\bbool|\bflag|\bwhole|\bind(ex|ices)\b|\bunit (vector|normal|quaternion)|\bunit\b|\bpose|\brotation"
    r"|\bmatri|\bquaternion|\bshare|\bnumber",
    re.I,
)
# Packages whose models have a source: the papers, as A(12) or B section 3, the literature, with its year, or "hexakin's
# own" where there is no paper.
SOURCED = {"kinematics", "walking", "control", "contact", "stability", "feasibility", "dynamics", "engines"}
SOURCE = re.compile(r"\b[AB](\(\d| Fig| Table| section| Step)|\b(18|19|20)\d\d\b|\bhexakin's own\b")
PLAIN = {"self", "cls", "args", "kwargs", "options", "engine_options", "unsaid"}


OBJECTS = public_objects()


def parameters_of(value):
    """Name -> annotation (as text) of what a caller gives: arguments, or the fields of a class."""
    if inspect.isclass(value):
        if dataclasses.is_dataclass(value):
            return {f.name: str(f.type) for f in dataclasses.fields(value)}
        if issubclass(value, tuple) and hasattr(value, "_fields"):
            return {name: str(value.__annotations__.get(name, "")) for name in value._fields}
        if "__init__" not in vars(value):
            return {}
        value = value.__init__
    signature = inspect.signature(value)
    return {
        p.name: str(p.annotation)
        for p in signature.parameters.values()
        if p.name not in PLAIN and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD) and not p.name.startswith("_")
    }


def texts_of(value):
    """The docstring, and for a method also that of its class."""
    own = inspect.getdoc(value) or ""
    if inspect.isclass(value) and "__init__" in vars(value) and not dataclasses.is_dataclass(value):
        own += "\n" + (inspect.getdoc(value.__init__) or "")
    return own


def named_in(name, text):
    return re.search(
        rf"(``[^`]*\b{re.escape(name)}\b[^`]*``)|(?m:^\s*[\w, ]*\b{re.escape(name)}\b[\w, ]*$)"
        rf"|(?m:^{re.escape(name)}\s)",
        text,
    )


def passage(name, text):
    """What is said of a parameter: its entry in a list of parameters, or 260 characters of prose from its name on."""
    at = named_in(name, text)
    if at is None:
        return ""
    first, *lines = text[at.start() :].splitlines()
    if first.startswith(name) and lines and lines[0].startswith("    "):
        return "\n".join([first, *itertools.takewhile(lambda line: not line or line.startswith(" "), lines)])
    return text[at.start() : at.start() + 260]


def row_of(name, text):
    """Shape and unit of a parameter in a table of rows "``name``  (shape)  unit  meaning", or None."""
    row = re.search(rf"(?m)^``{re.escape(name)}`` +(\([^)]+\)) {{2,}}(\S+)", text)
    return None if row is None else row.groups()


def raised_in(value):
    """Names of the package's errors that a function's own lines raise."""
    if inspect.isclass(value):
        members = [value.__dict__.get("__init__"), value.__dict__.get("__post_init__")]
        return set().union(*(raised_in(member) for member in members if inspect.isfunction(member)))
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(value)))
    except (OSError, TypeError):
        return set()
    raised = {
        node.exc.func.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and isinstance(node.exc.func, ast.Name)
    }
    return raised & ERRORS


def faults(name, value):
    text, said = texts_of(value), []
    if not text:
        return ["no docstring"]
    obvious = {"robot"}
    for parameter, annotation in parameters_of(value).items():
        if parameter in obvious:
            continue
        if not named_in(parameter, text):
            said.append(f"{parameter} is not named")
        elif ARRAYS.search(annotation):
            row, about = row_of(parameter, text), passage(parameter, text)
            if row is not None and SHAPE.fullmatch(row[0]):
                continue
            if not SHAPE.search(about):
                said.append(f"{parameter} has no shape")
            elif not UNIT.search(about):
                said.append(f"{parameter} has no unit")
    if inspect.isfunction(value) and re.search(r"\b(Array|NDArray)\b", str(inspect.signature(value).return_annotation)):
        if not SHAPE.search(text) or not UNIT.search(text):
            said.append("its result has no shape or unit")
    if name.split(".")[1] in SOURCED and not SOURCE.search(text + (inspect.getmodule(value).__doc__ or "")):
        said.append("no source: an equation or section of a paper, or literature")
    said += [
        f"{error} is not named"
        for error in sorted(raised_in(value))
        if error not in text and "errors as for" not in text.lower()
    ]
    return said


@pytest.mark.parametrize("name", OBJECTS)
def test_a_docstring_names_parameters_shapes_units_and_errors(name):
    assert faults(name, OBJECTS[name]) == []


def test_the_public_face_is_found():
    assert len(OBJECTS) > 150 and "hexakin.kinematics.inverse.inverse_kinematics" in OBJECTS
    assert installation.__name__ not in {name.rpartition(".")[0] for name in OBJECTS}
