"""Replay of recordings of machines on a simulated plant, with residuals between plant and recording."""
