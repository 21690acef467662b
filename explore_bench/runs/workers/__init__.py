"""Who runs trials: processes of this machine (`local`), or a dask cluster (`cluster`)."""

from __future__ import annotations

BACKENDS = ("processes", "sequential", "dask")

SHIPPED = ("baselines", "explore_bench")
"""Packages whose strategies may share a process."""

GRACE = 20.0
"""Seconds beyond its limit after which what cannot be interrupted is killed."""

THREAD_SETTINGS = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "TBB_NUM_THREADS"), "1"
)
"""Environment of a worker process: one thread each."""


class IncompleteError(RuntimeError):
    """A run ended before its plan was done; what it finished is stored (exit code 3)."""
