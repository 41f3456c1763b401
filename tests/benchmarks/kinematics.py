"""Time forward and inverse kinematics and Jacobians of ATHENA's six legs, by hexakin, NumPy and other libraries.

    python tests/benchmarks/kinematics.py [--quick]

Sizes go from one pose to a million. The results of each library are compared with hexakin's before it is timed. A
library that is slow or has no batches is timed for fewer poses. hexakin's times include the checks of shape and finite
numbers, and the flags for reach and limits of the inverse. The textbook's inverse computes the same flags; the
libraries check nothing. Every call returns new arrays. The time to get their memory from the system depends on what
the process did before. This affects all codes, mostly at a thousand poses. Times are those of the thread, so that other
processes do not count, although they use the same caches.
"""

import subprocess
import sys

import numpy as np
import peers
import textbook
from comparison import alone, compared, interleaved, timed
from precision import check, without_numba

import hexakin as hk
from hexakin.kinematics import evaluation

athena = hk.load_robot("athena")
SIZES = {1: 21, 10**3: 21, 10**5: 15, 10**6: 9}  # poses: repetitions
NUMPY, COMPILED, ONE = "hexakin, NumPy only", "hexakin, compiled", "hexakin"
BATCH_BARS = {
    ("forward", COMPILED): 0.05,
    ("forward", NUMPY): 0.30,
    ("inverse", COMPILED): 0.07,
    ("inverse", NUMPY): 0.40,
}
TEXTBOOK = "textbook NumPy"
COMPILE = "import hexakin as hk; from hexakin.kinematics.evaluation import prepare; prepare(hk.load_robot('athena'))"
SPAN = 0.02  # [s], shortest timing; a short call is repeated, so that caches are warm as in a loop
TOLERANCE, SEARCHED = 1e-10, 1e-6  # formulas: [m], [m/rad]; searches: [m] at the foot


def measure(quick=False):
    """Return the rows of all functions and sizes."""
    # Compile in another process: in the process that compiles it, the inverse has less than half of its later speed.
    subprocess.run([sys.executable, "-c", COMPILE], check=True)
    evaluation.prepare(athena)
    check(600 if quick else 100_000)
    rng = np.random.default_rng(5)
    codes = peers.codes(athena)
    rows = []
    for size, repetitions in SIZES.items():
        q = rng.uniform(athena.q_min, athena.q_max, (size, 6, 3))
        foot = textbook.forward(athena.parameters, q)
        for function, given in (("forward", q), ("jacobian", q), ("inverse", foot)):
            found = [code for code in codes if code.function == function]
            rows += of_function(function, given, found, 3 if quick else repetitions)
    return rows


def of_function(function, given, libraries, repetitions):
    """Return the rows of one function and size: each of hexakin's codes compared with all others."""
    size = len(given)
    ours = {ONE: own(function)} if size == 1 else {COMPILED: own(function), NUMPY: apart(function)}
    agree(function, given, peers.Code(function, TEXTBOOK, by_textbook(function), most=100_000))
    shares = {library.name: agree(function, given, library) for library in libraries}
    work = {name: timed(lambda call=call: call(given), SPAN) for name, call in ours.items()}
    work[TEXTBOOK] = timed(lambda: by_textbook(function)(given), SPAN)
    for library in libraries:
        work[library.name] = timed(lambda library=library: library.call(given[: library.most]), SPAN)
    times = interleaved(work, repetitions)
    shorter = {library.name: min(size, library.most) for library in libraries}
    pairs = {(name, TEXTBOOK): bar(function, size, name, TEXTBOOK) for name in ours}
    first = next(iter(ours))
    pairs |= {(first, library.name): bar(function, size, first, library.name) for library in libraries}
    return compared(function, size, "leg pose", times, pairs, units=6 * size, timed=shorter, agreed=shares)


def bar(function, size, name, other):
    """Return the bar of a pair, None for pairs without one."""
    if other == TEXTBOOK and size > 1:
        return BATCH_BARS.get((function, name))
    return 0.08 if (function, size, other) == ("forward", 1, "Robotics Toolbox, fkine") else None


def own(function):
    """Return hexakin's function; for one pose it is called without the axis of a batch."""
    call = {"forward": hk.forward_kinematics, "jacobian": hk.jacobian, "inverse": hk.inverse_kinematics}[function]
    return lambda values: call(athena, values[0] if len(values) == 1 else values)


def apart(function):
    """Return the same function without compiled loops."""
    call = own(function)

    def without(values):
        with without_numba():
            return call(values)

    return without


def by_textbook(function):
    """Return the textbook's function; the inverse also returns flags."""
    p = athena.parameters
    if function == "inverse":
        return lambda feet: textbook.inverse(p, feet, athena.q_min, athena.q_max)
    return lambda q: getattr(textbook, function)(p, q)


def agree(function, given, code):
    """Compare a library's results with hexakin's and return the share that agrees; of angles, the feet are compared."""
    part = given[: code.most]
    found, right = code.call(part), own(function)(part)
    if function == "inverse":
        found = textbook.forward(athena.parameters, found[0] if isinstance(found, tuple) else found)
        right = textbook.forward(athena.parameters, right.q)
    errors = np.abs(found - right).reshape(6 * len(part), -1).max(axis=1)
    share = float((errors < (SEARCHED if code.search else TOLERANCE)).mean())
    assert share == 1.0 or (code.search and share > 0.5), f"{code.name}, {function}: only {share:.1%} agree"
    return share


if __name__ == "__main__":
    alone(measure)
