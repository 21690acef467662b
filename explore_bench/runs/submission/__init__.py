"""A submission: the trials of one strategy in one suite in a file, with its code and weights, for others to check."""
