"""Plots over time in a recording."""
