"""Replay of recordings of machines on a simulated plant. Residuals quantify the difference."""
