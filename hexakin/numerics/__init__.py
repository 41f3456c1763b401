"""Fast trigonometry for arrays, and numba with a checked cache on disk."""
