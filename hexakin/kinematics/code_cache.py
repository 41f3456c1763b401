"""Numeric code of leg types that are not shipped, kept in the user's cache directory.

The name of a file depends on the leg type and on the generator's sources, so that the file of an older generator is
never read. A file begins with a checksum of the rest; one that is damaged counts as missing. Files are written under
another name and renamed, so that several processes may write at once. Where nothing can be written, or others may write
(``hexakin.numerics.cache_folders``), each process derives the code.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from functools import lru_cache
from pathlib import Path
from types import ModuleType

from hexakin import installation
from hexakin.numerics.cache_folders import usable, user_folder
from hexakin.robot.leg_table import LegTable

PARTS = ("numeric", "loops")

_MADE_BY = ("hexakin.symbolic.generate", "hexakin.generated")
"""The generator, and code that it wrote, which imports the modules that the code of every leg type runs with."""


def code_files(table: LegTable) -> dict[str, Path]:
    """Return the files ``numeric`` and ``loops`` of the leg type of ``table``; write them if they are not there.

    Raises OSError if they cannot be written, or if other users could have written them.
    """
    folder = user_folder("leg_types")
    if not usable(folder):
        raise OSError(f"{folder}: no folder for code")
    stem = hashlib.sha256(f"{_generator()}\n{table.type_key}".encode()).hexdigest()[:24]
    paths = {part: folder / f"leg_{stem}_{part}.py" for part in PARTS}
    if any(_checked(path) is None for path in paths.values()):
        sources = derived(table)
        for part, path in paths.items():
            _write(path, sources[part])
    return paths


def derived(table: LegTable) -> dict[str, str]:
    """Derive the source text of the leg type of ``table``, ``numeric`` and ``loops``."""
    from hexakin.symbolic.generate import generate

    sources = generate(table)
    return {"numeric": sources.numeric, "loops": sources.loops}


def loaded(path: Path) -> ModuleType:
    """Return the module of the file ``path``, which ``code_files`` returned.

    Raises OSError if the file was changed in the meantime.
    """
    text = _checked(path)
    if text is None:
        raise OSError(f"{path}: changed since it was written")
    return executed(text, str(path), path.stem)


def executed(text: str, filename: str, name: str) -> ModuleType:
    """Execute ``text``, written by the generator, and return the module.

    ``filename`` is shown in tracebacks; ``name`` is the last part of the module's name.
    """
    module = ModuleType(f"hexakin.generated.{name}")
    module.__file__ = filename
    # numba looks for the module of a function by its name, when it compiles the function and when it loads its code.
    sys.modules[module.__name__] = module
    try:
        exec(compile(text, filename, "exec"), module.__dict__)
    except BaseException:
        del sys.modules[module.__name__]
        raise
    return module


@lru_cache(maxsize=1)
def _generator() -> str:
    sources = installation.sources(_MADE_BY).values()
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


def _checked(path: Path) -> str | None:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None
    first, _, rest = text.partition("\n")
    return text if first == _checksum(rest) else None


def _checksum(text: str) -> str:
    return f"# sha256 {hashlib.sha256(text.encode()).hexdigest()}"


def _write(path: Path, text: str) -> None:
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
            file.write(f"{_checksum(text)}\n{text}")
        os.replace(temporary, path)
    except OSError:
        Path(temporary).unlink(missing_ok=True)
        raise
