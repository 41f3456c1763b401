"""Data of motions: recordings of simulations, planned walks, a common form of both, and measures of them."""
