"""The gate: results against an accepted reference, paired by world."""
