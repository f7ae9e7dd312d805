"""Logs of real machines: readers, column maps, replay on a plant, and identification of valve and vehicle."""
