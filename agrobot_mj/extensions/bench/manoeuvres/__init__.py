"""Validation of the plants: manoeuvres with known theoretical results, each with an acceptance band.

Most manoeuvres use the plants directly, without sensors and controllers. Closed-loop manoeuvres simulate complete
scenarios.
"""
