"""Planner of field work: headland laps, swaths and turns."""
