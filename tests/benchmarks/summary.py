"""Make the README's table of ratios from ``data/results/speed.csv``.

    python tests/benchmarks/summary.py

prints the text between the two marks in the README; ``tests/test_benchmarks.py`` compares both.
"""

import csv
import json
from pathlib import Path

RESULTS = Path(__file__).resolve().parents[2] / "data" / "results"

LINES = [
    # text in the table, and the row: benchmark, size, code, against
    ("forward kinematics, 10³ poses", "forward", 10**3, "hexakin, compiled", "textbook NumPy"),
    ("forward kinematics, 10⁶ poses", "forward", 10**6, "hexakin, compiled", "textbook NumPy"),
    ("forward, without numba, 10³ poses", "forward", 10**3, "hexakin, NumPy only", "textbook NumPy"),
    ("forward, without numba, 10⁶ poses", "forward", 10**6, "hexakin, NumPy only", "textbook NumPy"),
    ("forward kinematics, 10⁶ poses", "forward", 10**6, "hexakin, compiled", "CasADi, compiled C"),
    ("inverse kinematics, 10³ poses", "inverse", 10**3, "hexakin, compiled", "textbook NumPy"),
    ("inverse kinematics, 10⁶ poses", "inverse", 10**6, "hexakin, compiled", "textbook NumPy"),
    ("inverse, without numba, 10³ poses", "inverse", 10**3, "hexakin, NumPy only", "textbook NumPy"),
    ("inverse, without numba, 10⁶ poses", "inverse", 10**6, "hexakin, NumPy only", "textbook NumPy"),
    ("Jacobians, 10⁶ poses", "jacobian", 10**6, "hexakin, compiled", "textbook NumPy"),
    ("forward kinematics, one pose", "forward", 1, "hexakin", "Robotics Toolbox, fkine"),
    ("the same", "forward", 1, "hexakin", "Pinocchio"),
    ("the same", "forward", 1, "hexakin", "CasADi, compiled C"),
    ("inverse kinematics, one pose", "inverse", 1, "hexakin", "Robotics Toolbox, ik_LM"),
    ("derivation of a leg type", "derivation", 1, "hexakin", "simplify"),
    ("a step of `rigid`, level ground", "step, level", None, "rigid", "pybullet"),
    ("the same", "step, level", None, "rigid", "mujoco"),
    ("a step of `rigid`, blocks", "step, blocks", None, "rigid", "pybullet"),
    ("a walk with controller, blocks", "closed loop, blocks", None, "rigid", "pybullet"),
    ("`import hexakin`, which loads nothing", "import", 1, "import hexakin", "import numpy"),
    ("import and a first use", "import", 1, "import hexakin, first forward kinematics", "import numpy"),
    ("a study on two cores", "study", None, "two workers", "one worker"),
]
NAMES = {"pybullet": "PyBullet", "mujoco": "MuJoCo", "simplify": "`sympy.simplify`", "import numpy": "`import numpy`"}


def results(folder=RESULTS):
    """Return the rows of the table, as text by column, and the conditions of the run."""
    with open(folder / "speed.csv", encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream)), json.loads((folder / "speed.json").read_text(encoding="utf-8"))


def text(rows, about):
    """Return the conditions of the run and the table, as Markdown. Raises KeyError if a row of the table is missing."""
    found = {(row["benchmark"], row["code"], row["against"], int(row["size"])): row for row in rows}
    found |= {(benchmark, code, against, None): row for (benchmark, code, against, _), row in found.items()}
    lines = [f"Run of {about['date'][:10]}{caution(about)}", ""]
    lines += ["| hexakin | beside | time, as ratio | bar |", "|---|---|---|---|"]
    for said, benchmark, size, code, against in LINES:
        row = found[benchmark, code, against, size]
        ratio, bar = float(row["ratio"]), float(row["bar"] or "nan")
        verdict = f"{row['bar']} {'met' if ratio <= bar else 'missed'}" if row["bar"] else ""
        shown = f"{ratio:#.2g}"
        if (float(shown) <= bar) != (ratio <= bar):  # rounding would change the verdict
            shown = f"{ratio:#.3g}"
        lines.append(f"| {said} | {NAMES.get(against, against)} | {shown} | {verdict} |")
    bars = [float(row["ratio"]) <= float(row["bar"]) for row in rows if row["bar"]]
    return "\n".join([*lines, "", f"Of all {len(bars)} bars, {sum(bars)} are met."]) + "\n"


def caution(about):
    """Return a remark on a run with few repetitions or on a busy machine."""
    said = [name for name, true in (("few repetitions", about["quick"]), ("a busy machine", about["loaded"])) if true]
    return f", preliminary ({', '.join(said)}):" if said else ":"


if __name__ == "__main__":
    print(text(*results()), end="")
