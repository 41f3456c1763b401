"""Trigonometry of arrays, and numba with a cache that is checked."""
