"""The gains of paper A's posture control: those swept, simple control, and those that the paper chooses."""

from __future__ import annotations

from hexakin.exceptions import UnknownNameError

GAIN_LEVELS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
"""Values of each gain in the paper's sweeps (A section 5.2); the other two gains are then zero."""

SIMPLE = (0.0, 0.0, 0.0)
"""The gains (k_z, k_alpha, k_beta) of the paper's simple control, the reference of every change."""

CHOSEN = {"ramp": (0.8, 0.6, 0.0), "testbed": (0.6, 0.4, 0.4)}
"""The gains (k_z, k_alpha, k_beta) that the paper chooses for each scenario (A section 5.2.3)."""

GAINS = ("k_z", "k_alpha", "k_beta")


def settings(scenario: str) -> list[dict[str, float]]:
    """Gains of A Figs 10-19 in a scenario: each swept alone, and the chosen ones; simple control once."""
    swept = [tuple(level if gain == name else 0.0 for gain in GAINS) for name in GAINS for level in GAIN_LEVELS]
    return [dict(zip(GAINS, gains, strict=True)) for gains in dict.fromkeys([*swept, CHOSEN[scenario]])]


def compared(scenario: str) -> list[dict[str, float]]:
    """Simple control and the paper's chosen gains (A Figs 16-19)."""
    return [dict(zip(GAINS, gains, strict=True)) for gains in (SIMPLE, CHOSEN[scenario])]


def swept(gain: str) -> list[dict[str, float]]:
    """The six settings of one gain's sweep, the other two zero."""
    if gain not in GAINS:
        raise UnknownNameError("gain", gain, list(GAINS))
    return [{**dict.fromkeys(GAINS, 0.0), gain: level} for level in GAIN_LEVELS]
