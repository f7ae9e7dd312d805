"""Recordings of machines: their columns and maps, replay on a plant, identification of valve and vehicle."""
