"""Worlds of landmarks on coarse cells (§4.1): the true map, motion with noise, sensing with noise. Sees no estimate."""
