"""Replay: recordings of machines, mapped to SI units, drive a plant, and residuals say how far it is from them."""
