"""Falsification: search for the smallest failing change of a scenario, and evaluation of neighbouring cases."""
