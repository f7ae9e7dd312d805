"""Identification: the steering valve from a run, and the lateral dynamics of a vehicle from recordings."""
