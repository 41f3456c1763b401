"""Gaits, swing curves and paper B's planner."""
