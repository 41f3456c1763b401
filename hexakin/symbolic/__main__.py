"""Write the numeric code of all shipped robots' leg types: ``python -m hexakin.symbolic``."""

from __future__ import annotations

import sys

from hexakin.exceptions import exit_code
from hexakin.installation import DATA, PACKAGE
from hexakin.robot.file import load_robot
from hexakin.symbolic.generate import generate


def generated_files() -> dict[str, str]:
    """Return file name -> text of ``hexakin.generated`` for the leg types of all shipped robots."""
    files: dict[str, str] = {}
    modules: dict[str, tuple[str, str]] = {}
    for path in sorted((DATA / "robots").glob("*.yaml")):
        table = load_robot(path).table
        if table.type_key not in modules:
            modules[table.type_key] = (f"hexakin.generated.{path.stem}", f"hexakin.generated.{path.stem}_loops")
            sources = generate(table)
            files[f"{path.stem}.py"], files[f"{path.stem}_loops.py"] = sources.numeric, sources.loops
    entries = "".join(f'    "{key}": ("{numeric}", "{loops}"),\n' for key, (numeric, loops) in modules.items())
    files["__init__.py"] = (
        '"""Generated kinematics of the shipped leg types, each named after the first robot that has it."""\n\n'
        f'MODULES = {{\n{entries}}}\n"""The modules of a leg type, numeric and loops, by its key."""\n'
    )
    return files


def write_generated_files() -> None:
    """Rewrite ``hexakin.generated``."""
    for name, text in generated_files().items():
        (PACKAGE / "generated" / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(exit_code(write_generated_files))
