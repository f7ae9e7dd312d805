"""Searches over many runs: limits, rare failures, mild failures, influence of parameters, gains."""
