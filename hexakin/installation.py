"""The installed package: its version, its data folder, its source files, and what each module imports."""

from __future__ import annotations

import ast
import contextlib
import hashlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path

__version__ = "0.2.0"

PACKAGE = Path(__file__).resolve().parent

# A wheel contains data/ inside the package; a checkout has it beside the package.
DATA = PACKAGE / "data" if (PACKAGE / "data").is_dir() else PACKAGE.parent / "data"

_NAME = PACKAGE.name


def versions(packages: Iterable[str] = ()) -> dict[str, str]:
    """Return the versions of Python, of hexakin and of the distributions ``packages``, by their names.

    A distribution that is not installed, or whose version cannot be read, is left out.
    """
    import platform  # here, since importing hexakin is to take no time
    from importlib import metadata

    found = {"python": platform.python_version(), "hexakin": __version__}
    for name in packages:
        with contextlib.suppress(Exception):  # damaged metadata may raise any error, and no result is worth less for it
            found[name] = metadata.version(name) or "unknown"
    return found


@cache
def modules() -> dict[str, Path]:
    """Return the source file of every module of hexakin, by the module's full name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = [_NAME, *path.relative_to(PACKAGE).with_suffix("").parts]
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def imports(module: str) -> frozenset[str]:
    """Return the full names of the modules that ``module`` of hexakin imports, anywhere in its file.

    A string that is the full name of a module, or ``module:name``, counts as an import, since such modules are loaded
    by their names.
    Modules of other packages appear as they are written. Raises KeyError if ``module`` is not a module of hexakin.
    """
    known, named = modules(), set()
    for node in ast.walk(_parsed(module)):
        if isinstance(node, ast.Import):
            named |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            # A name imported from a package may be a module of this package.
            inner = {f"{node.module}.{alias.name}" for alias in node.names} & known.keys()
            named |= inner if len(inner) == len(node.names) else {node.module, *inner}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            named |= {node.value.partition(":")[0]} & known.keys()
    # Importing hexakin runs nothing but the table of public names.
    return frozenset(name for name in named if name in known or name.partition(".")[0] != _NAME) - {_NAME}


def sources(roots: Iterable[str], *, without: Iterable[str] = ()) -> dict[str, Path]:
    """Return the source files of the modules ``roots`` and of all modules that they import, directly or indirectly.

    The result maps full names to files. Packages and modules in ``without`` are left out, and so are modules that only
    they import. Raises KeyError for a name that is not a module of hexakin.
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
    """Return a checksum (SHA-256, hex) of the code of ``sources(roots, without=without)``.

    Comments and docstrings do not count.
    """
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
