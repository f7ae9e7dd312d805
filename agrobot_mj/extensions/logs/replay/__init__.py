"""Replay of recordings of machines on a plant, with residuals that quantify the difference."""
