"""Kinematics of ATHENA's legs in NumPy, written directly from the formulas of paper A.

``p`` (6, 5) are the parameters of the legs: theta_1 [rad], l_1 to l_4 [m]. Angles and feet have shape (..., 6, 3).
"""

import numpy as np


def forward(p, q):
    """A(12): angles [rad] -> feet [m]."""
    theta_1, l_1, l_2, l_3, l_4 = p.T
    angle, femur = theta_1 + q[..., 0], q[..., 1]
    tibia = femur + q[..., 2]
    radius = l_2 + l_3 * np.cos(femur) + l_4 * np.cos(tibia)
    x = l_1 * np.cos(theta_1) + radius * np.cos(angle)
    y = l_1 * np.sin(theta_1) + radius * np.sin(angle)
    return np.stack([x, y, l_3 * np.sin(femur) + l_4 * np.sin(tibia)], axis=-1)


def jacobian(p, q):
    """The derivative of A(12): angles [rad] -> Jacobians (..., 6, 3, 3) [m/rad]."""
    theta_1, _, l_2, l_3, l_4 = p.T
    angle, femur = theta_1 + q[..., 0], q[..., 1]
    tibia = femur + q[..., 2]
    radius = l_2 + l_3 * np.cos(femur) + l_4 * np.cos(tibia)
    up = -l_3 * np.sin(femur) - l_4 * np.sin(tibia)  # derivative of the radius by the second angle
    x = [-radius * np.sin(angle), up * np.cos(angle), -l_4 * np.sin(tibia) * np.cos(angle)]
    y = [radius * np.cos(angle), up * np.sin(angle), -l_4 * np.sin(tibia) * np.sin(angle)]
    z = [np.zeros_like(angle), l_3 * np.cos(femur) + l_4 * np.cos(tibia), l_4 * np.cos(tibia)]
    return np.stack([np.stack(row, axis=-1) for row in (x, y, z)], axis=-2)


def inverse(p, foot, low, high):
    """A(14)-(18), with the knee bent as in the standing pose: feet [m] -> angles [rad], reachable, within limits."""
    theta_1, l_1, l_2, l_3, l_4 = p.T
    x, y = foot[..., 0] - l_1 * np.cos(theta_1), foot[..., 1] - l_1 * np.sin(theta_1)
    z, radius = foot[..., 2], np.hypot(x, y) - l_2
    cosine = (radius**2 + z**2 - l_3**2 - l_4**2) / (2 * l_3 * l_4)
    reachable = np.abs(cosine) <= 1.0
    knee = -np.arccos(np.clip(cosine, -1.0, 1.0))
    femur = np.arctan2(z, radius) - np.arctan2(l_4 * np.sin(knee), l_3 + l_4 * np.cos(knee))
    first = np.arctan2(y, x) - theta_1
    q = np.stack([first, femur, knee], axis=-1)
    q = (q + np.pi) % (2 * np.pi) - np.pi
    q[~reachable] = np.nan
    return q, reachable, np.all((q >= low) & (q <= high), axis=-1)
