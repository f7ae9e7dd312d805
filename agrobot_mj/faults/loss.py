"""Readings that do not arrive: a cut wire, a sensor without power."""

from typing import Literal

from agrobot_mj.core.signals import Conditions
from agrobot_mj.faults.line import LineFault


class Lost(LineFault):
    """A reading that is missing, which the tractor's computer notices."""

    def apply(self, state: None, conditions: Conditions, t: float, dt: float) -> tuple[None, Conditions]:
        """Withhold the reading."""
        return None, self.distorted(conditions, lost=True)


class HeadingLoss(Lost):
    """The receiver has no heading from its two antennas, while its position is sound."""

    kind: Literal["heading_loss"] = "heading_loss"


class GyroLoss(Lost):
    """The gyro is silent."""

    kind: Literal["gyro_loss"] = "gyro_loss"


class WheelSpeedLoss(Lost):
    """The wheel speed sensor is silent."""

    kind: Literal["wheel_speed_loss"] = "wheel_speed_loss"
