"""Validation of the plants: manoeuvres with known theoretical results, each with an acceptance band.

The manoeuvres use the plants directly, without sensors and controllers.
"""

from agrobot_mj.extensions.bench.manoeuvres.base import Check
from agrobot_mj.extensions.bench.manoeuvres.suite import validate

__all__ = ["Check", "validate"]
