"""Guidance laws and steering loops that learn during a run."""
