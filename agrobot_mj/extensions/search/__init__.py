"""Searches over many runs: limits, rare failures, smallest failing changes, importance of parameters, gains."""
