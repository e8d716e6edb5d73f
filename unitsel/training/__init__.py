"""Weights from recordings: Pareto optimisation over the path cost."""
