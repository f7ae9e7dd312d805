"""Sweeps: runs of a scenario for all combinations of parameter values, samples, seeds and variants, in one table."""
