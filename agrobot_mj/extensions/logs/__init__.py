"""Logs of real machines: reading, mapping of columns, replay on a plant, identification of valve and vehicle."""
