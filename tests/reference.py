"""Write the reference of the library from its docstrings: ``python tests/reference.py FOLDER``."""

import importlib.util
import subprocess
import sys

from hexakin.installation import modules

# pdoc cannot evaluate the annotations of NamedTuples and shows them as text.
WARNINGS = ("ignore:Error parsing type annotation", "ignore:The module specification")


def main(folder):
    """Write the pages into ``folder``."""
    # All modules are named, because pdoc leaves out modules that are not in a package's __all__.
    left_out, program = ["!hexakin.generated"], "import sys, pdoc.__main__; pdoc.__main__.cli(sys.argv[1:])"
    if importlib.util.find_spec("pybullet") is None:  # pdoc imports what it describes
        left_out += [f"!hexakin.engines.pybullet_{part}" for part in ("engine", "ground", "import")]
    if importlib.util.find_spec("mujoco") is None:
        left_out += [f"!hexakin.engines.mujoco_{part}" for part in ("engine", "scene")]
    else:
        # While pdoc imports a module, it lets no process start; MuJoCo's window library starts one when it is imported.
        program = f"import mujoco; {program}"
    filters = [word for text in WARNINGS for word in ("-W", text)]
    pdoc = [sys.executable, *filters, "-c", program, "--docformat", "numpy", "--output-directory", folder]
    return subprocess.call([*pdoc, *modules(), *left_out])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
