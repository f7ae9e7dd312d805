"""Logs of real machines: reading and mapping columns, replay on a plant, identification of valve and vehicle."""
