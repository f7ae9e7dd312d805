"""Simulation of a scenario: tick (one control period), loop over ticks, log, and files of a run."""
