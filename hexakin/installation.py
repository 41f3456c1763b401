"""What is installed of hexakin: its version, its data, and the source files that a module is made of."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path

__version__ = "0.1.0"

PACKAGE = Path(__file__).resolve().parent

# A wheel carries data/ inside the package; a checkout has it beside the package.
DATA = PACKAGE / "data" if (PACKAGE / "data").is_dir() else PACKAGE.parent / "data"

_NAME = PACKAGE.name


@cache
def modules() -> dict[str, Path]:
    """Every module of hexakin by its full name, with its source file."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = [_NAME, *path.relative_to(PACKAGE).with_suffix("").parts]
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def imports(module: str) -> frozenset[str]:
    """Full names of the modules that a module of hexakin imports, anywhere in its file.

    A string that is a module's full name counts as an import: such modules are loaded by their names. Modules of
    other packages are named as they are written. Raises KeyError for a name that is no module of hexakin.
    """
    known, named = modules(), set()
    for node in ast.walk(_parsed(module)):
        if isinstance(node, ast.Import):
            named |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            # What is imported from a package may be a module of it.
            inner = {f"{node.module}.{alias.name}" for alias in node.names} & known.keys()
            named |= inner if len(inner) == len(node.names) else {node.module, *inner}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in known:
            named.add(node.value)
    # The face of hexakin itself only maps names to modules.
    return frozenset(name for name in named if name in known or name.partition(".")[0] != _NAME) - {_NAME}


def sources(roots: Iterable[str], *, without: Iterable[str] = ()) -> dict[str, Path]:
    """Source files, by module, of some modules and of all that they import, directly or not.

    Packages and modules named in ``without`` are left out, and what only they import.
    Raises KeyError for a name that is no module of hexakin.
    """
    found: dict[str, Path] = {}
    waiting = list(roots)
    while waiting:
        module = waiting.pop()
        if module not in found and not any(f"{module}.".startswith(f"{name}.") for name in without):
            found[module] = modules()[module]
            waiting += [name for name in imports(module) if name in modules()]
    return dict(sorted(found.items()))


def digest(roots: Iterable[str], *, without: Iterable[str] = ()) -> str:
    """Checksum of what ``sources`` of some modules do: of their code without comments and docstrings."""
    total = hashlib.sha256()
    for module in sources(roots, without=without):
        total.update(f"{module}\n{_code(module)}\n".encode())
    return total.hexdigest()


def _parsed(module: str) -> ast.Module:
    path = modules()[module]
    return ast.parse(path.read_bytes(), str(path))


@cache
def _code(module: str) -> str:
    tree = _parsed(module)
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            node.body = [statement for statement in node.body if not _is_text(statement)]
    return ast.dump(tree)


def _is_text(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
