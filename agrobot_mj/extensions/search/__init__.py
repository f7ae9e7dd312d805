"""Searches over many runs: limits of laws, rare failures, smallest failing changes, important parameters, and gains."""
