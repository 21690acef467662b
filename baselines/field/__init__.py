"""Exploration rules of others that the paper does not compare, as far as they choose among places to look from.

docs/field.md has each as a formula, with the source of its constants and what was converted. What several rules ask
for is written once: the map and its frontiers in `believed.py`, what is visible in `views.py`, what a candidate is
worth by one measure in `terms.py`.
"""
