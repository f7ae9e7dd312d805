"""Validation of the plants: manoeuvres with a known answer, each against its band.

An outer layer: it drives plants directly, below the loop of sensors and controllers.
"""

from agrobot_mj.extensions.bench.manoeuvres.base import Check
from agrobot_mj.extensions.bench.manoeuvres.suite import validate

__all__ = ["Check", "validate"]
