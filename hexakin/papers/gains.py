"""Gains of paper A's posture control: the swept levels, simple control, and the gains that the paper chooses."""

from __future__ import annotations

from hexakin.exceptions import UnknownNameError

GAIN_LEVELS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
"""Levels of each gain in the paper's sweeps, in which the other two gains are zero (A section 5.2)."""

SIMPLE = (0.0, 0.0, 0.0)
"""Gains (k_z, k_alpha, k_beta) of the paper's simple control, the reference of every change."""

CHOSEN = {"ramp": (0.8, 0.6, 0.0), "testbed": (0.6, 0.4, 0.4)}
"""Gains (k_z, k_alpha, k_beta) that the paper chooses for each scenario (A section 5.2.3)."""

GAINS = ("k_z", "k_alpha", "k_beta")


def settings(scenario: str) -> list[dict[str, float]]:
    """Gains of A Figs 10-19 for a scenario: a sweep of each gain and the chosen gains; simple control only once.

    Raises UnknownNameError for an unknown ``scenario``.
    """
    swept = [tuple(level if gain == name else 0.0 for gain in GAINS) for name in GAINS for level in GAIN_LEVELS]
    return [dict(zip(GAINS, gains, strict=True)) for gains in dict.fromkeys([*swept, _chosen(scenario)])]


def compared(scenario: str) -> list[dict[str, float]]:
    """Gains of simple control and the paper's chosen gains for a scenario (A Figs 16-19).

    Raises UnknownNameError for an unknown ``scenario``.
    """
    return [dict(zip(GAINS, gains, strict=True)) for gains in (SIMPLE, _chosen(scenario))]


def _chosen(scenario: str) -> tuple[float, float, float]:
    if scenario not in CHOSEN:
        raise UnknownNameError("scenario", scenario, list(CHOSEN))
    return CHOSEN[scenario]


def swept(gain: str) -> list[dict[str, float]]:
    """Gains of the six runs of one gain's sweep; the other two gains are zero. Raises UnknownNameError."""
    if gain not in GAINS:
        raise UnknownNameError("gain", gain, list(GAINS))
    return [{**dict.fromkeys(GAINS, 0.0), gain: level} for level in GAIN_LEVELS]
