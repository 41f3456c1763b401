"""Write hexakin/__init__.pyi, by which editors and type checkers know the public names: ``make generated``.

The names stand in the table in hexakin/__init__.py and nowhere else; the stub is made of it.
"""

import hexakin as hk
from hexakin.installation import PACKAGE

STUB = PACKAGE / "__init__.pyi"
HEAD = '''"""Public names with their types, made of the table in __init__.py by ``make generated``; not to be edited."""
# ruff: noqa

from hexakin.installation import __version__ as __version__
'''


def text() -> str:
    """What the stub should be."""
    lines = []
    for name, place in hk.PUBLIC.items():
        module, _, attribute = place.partition(":")
        source, _, last = module.rpartition(".")
        lines.append(f"from {module if attribute else source} import {attribute or last} as {name}")
    names = "".join(f"    {name!r},\n" for name in hk.__all__).replace("'", '"')
    return HEAD + "\n".join(lines) + f"\n\nPUBLIC: dict[str, str]\n__all__ = [\n{names}]\n"


if __name__ == "__main__":
    STUB.write_text(text(), encoding="utf-8")
