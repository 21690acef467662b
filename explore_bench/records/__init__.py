"""The store: one shard a trial, under the digest of everything that defines it."""
