"""Identification of a steering valve from a run, and of a vehicle's lateral dynamics from recordings."""
