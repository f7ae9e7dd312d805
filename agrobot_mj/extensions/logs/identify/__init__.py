"""Identification of the steering valve from a run, and of the lateral vehicle dynamics from recordings."""
