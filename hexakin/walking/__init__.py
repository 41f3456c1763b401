"""Gaits, paths of the feet, and the planner of paper B."""
