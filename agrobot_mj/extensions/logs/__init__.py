"""Logs of real machines: readers, maps of columns, replay on a plant, and identification of valve and vehicle."""
