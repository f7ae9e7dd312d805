"""Planner of field work: headland laps, swaths, and the turns between them."""
