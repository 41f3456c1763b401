"""Time the derivation of ATHENA's forward kinematics, Jacobian and inverse, and that by ``sympy.simplify``.

    python tests/benchmarks/derivation.py [--quick]

The second derivation multiplies the matrices of the leg table and simplifies them. It ends with the foot in the frame
of the first joint; the three angles would still have to be derived by hand. hexakin's derivation ends with the angles.
The cache of sympy is cleared before each. Numeric values of both are compared first.
"""

import numpy as np
import sympy as sp
from comparison import alone, compared, interleaved, timed

import hexakin as hk

athena = hk.load_robot("athena")


def derived():
    """Derive with hexakin."""
    sp.core.cache.clear_cache()
    leg = hk.symbolic.derive(athena.table)
    return leg, leg.forward, leg.jacobian, leg.inverse


def simplified():
    """Multiply the matrices of the leg table and simplify them."""
    sp.core.cache.clear_cache()
    leg = hk.symbolic.derive(athena.table)
    rows = [leg.transform(k, k + 1) for k in range(4)]
    forward = sp.simplify(rows[0] * rows[1] * rows[2] * rows[3])
    jacobian = sp.simplify(forward[:3, 3].jacobian(leg.joints))
    return leg, forward, jacobian, sp.simplify((rows[0] * rows[1]).inv() * forward)


def measure(quick=False):
    """Return one row."""
    (_, forward, jacobian, _), (_, pose, other, _) = derived(), simplified()
    symbols = sorted(pose.free_symbols, key=str)
    values = dict(zip(symbols, np.random.default_rng(5).uniform(0.1, 1.0, len(symbols)), strict=True))
    for name, ours, theirs in (("forward", forward, pose), ("Jacobian", jacobian, other)):
        ours, theirs = (np.array(sp.Matrix(m).subs(values).evalf().tolist(), float) for m in (ours, theirs))
        assert np.abs(ours - theirs).max() < 1e-12, name
    times = interleaved({"hexakin": timed(derived), "simplify": timed(simplified)}, 2 if quick else 5)
    return compared("derivation", 1, "leg type", times, {("hexakin", "simplify"): 0.02})


if __name__ == "__main__":
    alone(measure)
