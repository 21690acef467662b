"""The strategies of Zhang et al. 2021 and of its comparisons, each in a file; `catalogue` is the table of all."""

from baselines.catalogue import STRATEGIES as STRATEGIES
