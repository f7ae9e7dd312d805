"""Searches over many runs: limits of guidance laws, rare failures, smallest failing changes, important parameters, and
gains."""
