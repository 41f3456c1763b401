"""Coulomb's law at one contact, solved exactly, compiled.

The impulse is p = (p_t, p_n) and the velocity u = W p + q, with a positive definite W (3, 3). Given p_n, the friction
p_t minimises p_t' W_tt p_t / 2 + (q_t + W_tn p_n)' p_t on the disc |p_t| <= mu p_n. What remains is one equation: the
normal velocity u_n(p_n) is zero, or positive at the smallest normal impulse. As u_n increases without bound with p_n,
there is a solution; with large friction there may be several.
"""

from __future__ import annotations

import numpy as np

from hexakin.checks import Array
from hexakin.numerics.numba_cache import no_new_arrays

_EXACT = 1e-15  # relative error at which iterations end


@no_new_arrays
def disc(a: float, b: float, d: float, gx: float, gy: float, radius: float) -> tuple[float, float, float]:
    """Minimise p'Wp/2 + g'p over |p| <= ``radius``, for positive definite W = [[a, b], [b, d]] and g = (gx, gy).

    Return p and the multiplier s with (W + s I) p = -g: 0 inside the disc, positive on its boundary, and infinite if
    the radius is zero.
    """
    det = a * d - b * b
    x, y = -(d * gx - b * gy) / det, -(a * gy - b * gx) / det
    if x * x + y * y <= radius * radius:
        return x, y, 0.0
    if radius <= 0.0:
        return 0.0, 0.0, np.inf
    # Newton's method for 1/|p| = 1/radius converges monotonically in s.
    shift, norm = 0.0, np.sqrt(x * x + y * y)
    for _ in range(50):
        dx, dy = (d + shift) * x - b * y, (a + shift) * y - b * x
        slope = (x * dx + y * dy) / det
        shift += (norm - radius) / radius * norm * norm / slope
        det = (a + shift) * (d + shift) - b * b
        x, y = -((d + shift) * gx - b * gy) / det, -((a + shift) * gy - b * gx) / det
        norm = np.sqrt(x * x + y * y)
        if abs(norm - radius) <= _EXACT * radius:
            break
    return x * radius / norm, y * radius / norm, shift


@no_new_arrays
def solve_contact(G: Array, k: int, mu: float, p_min: float, p: Array, u: Array) -> tuple[float, float, float]:
    """Return the impulse (t1, t2, n) of the contact in rows ``k`` to ``k`` + 2 if all other impulses stay as they are.

    ``G`` and ``u`` are the matrix and the velocities at the impulses ``p``; ``mu`` and ``p_min`` are the friction
    coefficient and the smallest normal impulse of the contact.
    """
    n = k + 2
    a, b, d = G[k, k], G[k, k + 1], G[k + 1, k + 1]
    wx, wy, wn = G[k, n], G[k + 1, n], G[n, n]
    # Where the motion of a contact is restricted, W is singular; the error of this is removed by Newton's method.
    a, d = a * (1.0 + 1e-13), d * (1.0 + 1e-13)
    qx = u[k] - a * p[k] - b * p[k + 1] - wx * p[n]
    qy = u[k + 1] - b * p[k] - d * p[k + 1] - wy * p[n]
    qn = u[n] - wx * p[k] - wy * p[k + 1] - wn * p[n]
    x, y, shift = disc(a, b, d, qx + wx * p_min, qy + wy * p_min, mu * p_min)
    if qn + wx * x + wy * y + wn * p_min >= 0.0:
        return x, y, p_min
    # u_n is negative at ``below`` and positive at ``above``; Newton's method, safeguarded by bisection. It begins at
    # the present impulse, so that of several solutions the one nearby is found.
    below, above = p_min, np.inf
    normal = p[n] if p[n] > p_min else max(-qn / wn, 2.0 * p_min)
    if not normal > p_min:
        normal = abs(qn) / wn
    for _ in range(60):
        x, y, shift = disc(a, b, d, qx + wx * normal, qy + wy * normal, mu * normal)
        value = qn + wx * x + wy * y + wn * normal
        if value < 0.0:
            below = normal
        else:
            above = normal
        # The derivatives of p_t by p_n: (W_tt + s I) p_t' + s' p_t = -W_tn, and on the boundary p_t p_t' = mu^2 p_n.
        sx = sy = 0.0
        if shift < np.inf:
            det = (a + shift) * (d + shift) - b * b
            sx, sy = -((d + shift) * wx - b * wy) / det, -((a + shift) * wy - b * wx) / det
        if 0.0 < shift < np.inf:
            tx, ty = ((d + shift) * x - b * y) / det, ((a + shift) * y - b * x) / det
            rate = (x * sx + y * sy - mu * mu * normal) / (x * tx + y * ty)
            sx, sy = sx - rate * tx, sy - rate * ty
        slope = wx * sx + wy * sy + wn
        new = normal - value / slope
        if not below < new < above:
            new = 0.5 * (below + above) if above < np.inf else 2.0 * normal
        if abs(new - normal) <= _EXACT * normal:
            break
        normal = new
    return x, y, normal
