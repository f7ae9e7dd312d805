"""Replay: recordings of machines, mapped to SI units, drive a plant; residuals quantify the difference."""
