"""Walks of a robot under a controller: in an engine (``simulate``) or with ideal servos (``commanded_walk``)."""

from hexakin.simulation.closed_loop import simulate
from hexakin.simulation.commanded_walk import commanded_walk

__all__ = ["commanded_walk", "simulate"]
