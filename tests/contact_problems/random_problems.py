"""Random contact problems in classes, their first guesses, and how far impulses are from a solution.

All have velocities u = J v with v = v_free + M^-1 J' p for a positive definite M. Then Coulomb's law has a solution,
whatever the normals are (Anitescu and Potra 1997; friction in a disc is the limit of friction in a polygon).
"""

from typing import NamedTuple

import numpy as np

CLASSES = ("many bodies", "one body", "expansion", "servos")
FRICTION = (0.0, 0.1, 0.9, 2.0, 5.0, 20.0, 50.0)
COMPLIANCES = (0.0, 1e-6)  # of the mean of the diagonal of G
STARTS = ("cold", "warm")
MOST_CONTACTS = 8
_SIZE = 0.2  # [m] of the body
_MASS = 2.0  # [kg]


class Problem(NamedTuple):
    """Velocities G p + g of n contacts and m servos, see ``hexakin.contact.cone.ConeProblem``."""

    G: np.ndarray
    g: np.ndarray
    mu: np.ndarray
    p_min: np.ndarray
    low: np.ndarray
    high: np.ndarray


def random_problem(rng, kind, friction, compliance):
    """Return a problem of one of ``CLASSES``, and one whose velocities are a little different.

    ``many bodies``: 1 to 8 contacts between bodies, as many coordinates as impulses or more. ``one body``: all contacts
    are on one body with six coordinates, so that from three contacts on they are redundant. ``expansion``: either of
    them, with smallest normal impulses for half of the contacts. ``servos``: a body with one to six legs of three
    joints that have servos with limited impulses.
    """
    n = int(rng.integers(1, MOST_CONTACTS + 1))
    legs = int(rng.integers(1, 7)) if kind == "servos" else 0
    single = kind in ("one body", "servos") or (kind == "expansion" and rng.random() < 0.5)
    if kind == "servos":
        n = legs
    if single:
        J = _on_one_body(rng, n, legs)
        half = rng.normal(size=(3 * legs, 3 * legs)) * 0.02
        M = np.diag([_MASS] * 3 + [0.4 * _MASS * _SIZE**2] * 3 + [1e-3] * (3 * legs))
        M[6:, 6:] += half @ half.T
    else:
        J = rng.normal(size=(3 * n, 3 * n + int(rng.integers(0, 7))))
        M = np.diag(np.exp(rng.normal(size=J.shape[1])))
    v_free = rng.normal(size=J.shape[1])
    if single:
        v_free[2] -= 1.0  # towards the ground
    J = np.vstack([J, np.eye(J.shape[1])[6 : 6 + 3 * legs]]) if legs else J
    G = J @ np.linalg.solve(M, J.T)
    G = 0.5 * (G + G.T)
    G[np.diag_indices(3 * n)] += compliance * np.trace(G[: 3 * n, : 3 * n]) / (3 * n)
    typical = 1.0 / np.diag(G)
    p_min = np.zeros(n)
    if kind == "expansion":
        p_min = rng.random(n) * (rng.random(n) < 0.5) * typical[2 : 3 * n : 3]
    limit = rng.random(3 * legs) * 2.0 * typical[3 * n :]
    first = Problem(G, J @ v_free, np.full(n, friction), p_min, -limit, limit)
    return first, first._replace(g=J @ (v_free + 0.05 * rng.normal(size=v_free.size)))


def _on_one_body(rng, n, legs):
    """Return the Jacobian (3 n, 6 + 3 legs): contacts under a body, half of the times on level ground."""
    level = rng.random() < 0.5
    J = np.zeros((3 * n, 6 + 3 * legs))
    for c in range(n):
        x = np.append(rng.uniform(-_SIZE, _SIZE, 2), -_SIZE * rng.random())
        normal = np.array([0.0, 0.0, 1.0]) + (0.0 if level else 0.5) * rng.normal(size=3) * [1.0, 1.0, 0.0]
        normal /= np.linalg.norm(normal)
        first = np.cross([0.0, 1.0, 0.0], normal)
        first /= np.linalg.norm(first)
        frame = np.array([first, np.cross(normal, first), normal])
        J[3 * c : 3 * c + 3, :3] = frame
        J[3 * c : 3 * c + 3, 3:6] = np.cross(x, frame)
        if legs:
            J[3 * c : 3 * c + 3, 6 + 3 * c : 9 + 3 * c] = frame @ rng.normal(size=(3, 3)) * 0.15
    return J


def residual(problem, p):
    """Distance by which Coulomb's law fails, relative to the largest impulse; not by the library's own code."""
    G, g, mu, p_min, low, high = problem
    n = mu.size
    rows = 3 * n
    rho = np.concatenate([np.repeat(3.0 / np.diag(G)[:rows].reshape(-1, 3).sum(1), 3), 1.0 / np.diag(G)[rows:]])
    y = p - rho * (G @ p + g)
    tangential, normal = y[:rows].reshape(-1, 3)[:, :2], np.maximum(y[2:rows:3], p_min)
    bound, length = mu * np.maximum(p[2:rows:3], 0.0), np.linalg.norm(tangential, axis=1)
    share = np.divide(bound, length, out=np.ones(n), where=length > bound)
    slip = np.linalg.norm(tangential * share[:, None] - p[:rows].reshape(-1, 3)[:, :2], axis=1)
    moved = np.concatenate([slip, normal - p[2:rows:3], np.clip(y[rows:], low, high) - p[rows:]])
    scale = max(np.abs(p).max(), 1e-3 * np.abs(rho * g).max(), p_min.max())
    return np.abs(moved).max() / scale
