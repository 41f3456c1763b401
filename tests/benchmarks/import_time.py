"""Time ``import hexakin`` against ``import numpy``, each in a fresh interpreter and measured inside it.

hexakin loads all packages when they are first used, NumPy too. A program needs more than the time of the import, so
that a second row also contains the time of a first use.

    python tests/benchmarks/import_time.py [--quick]
"""

import functools
import subprocess
import sys

from comparison import alone, compared, interleaved

SCRIPT = "import time; start = time.perf_counter(); {}; print(time.perf_counter() - start)"
NUMPY, OURS = "import numpy", "import hexakin"
FIRST_USE = "import hexakin, first forward kinematics"
CODE = {
    NUMPY: NUMPY,
    OURS: OURS,
    FIRST_USE: "import hexakin as hk; r = hk.load_robot('athena'); hk.forward_kinematics(r, r.standing_q)",
}


def seconds(code):
    """Return the time [s] of some code in a fresh interpreter."""
    return float(subprocess.run([sys.executable, "-c", SCRIPT.format(code)], capture_output=True, check=True).stdout)


def measure(quick=False):
    """Return two rows: the import, and the import with a first use of a robot's kinematics."""
    times = interleaved({name: functools.partial(seconds, code) for name, code in CODE.items()}, 5 if quick else 25)
    return compared("import", 1, "import", times, {(OURS, NUMPY): 0.35, (FIRST_USE, NUMPY): None}, clock="wall")


if __name__ == "__main__":
    alone(measure)
