"""Many trials: suites, the runner and its workers, merging, timing, and the conformance kit."""
