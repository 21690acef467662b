"""The contract of a strategy, how one is registered and found, and how it is brought to life."""
