"""Validation of the plants: manoeuvres with a known theoretical result, each with an acceptance band.

The manoeuvres drive plants directly, without the loop of sensors and controllers.
"""

from agrobot_mj.extensions.bench.manoeuvres.base import Check
from agrobot_mj.extensions.bench.manoeuvres.suite import validate

__all__ = ["Check", "validate"]
