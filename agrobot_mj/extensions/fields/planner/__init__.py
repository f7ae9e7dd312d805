"""Planner of field work: headland laps, swaths, and the turns that join them."""
