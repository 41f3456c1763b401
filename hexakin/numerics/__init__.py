"""Fast trigonometry for arrays, numba with a checked cache on disk, and how long arrays are printed."""
