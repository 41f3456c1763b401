"""Fast trigonometry for arrays, numba with a checked cache on disk, how values are printed, and messages on stderr."""
