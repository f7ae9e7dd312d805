"""Steering geometry and linkage of the front axle: kingpins, caster, play and friction between cylinder and wheels.

The axis of a kingpin meets the ground, at the static load, `kingpin_offset_m` inside the wheel's centre plane; its top
is inclined inwards and backwards by the caster angle. The tyre forces therefore have a lever arm about the axis, and
the cylinder carries them: the impact of a stone, the weight lifted by steering, the side force times the caster trail.
All defaults are zero: wheels that rotate about their own centres, without play. The bicycle uses only the backlash.
"""

from math import radians, sqrt, tan
from typing import Annotated

from pydantic import Field

from agrobot_mj.core.spec import NonNegative, Spec
from agrobot_mj.machine.tractor import TractorParameters

DRY_GRIP = 0.75
"""Friction under a scrubbing contact patch on dry ground [-]. Assumed value (0.6-0.8 in the field)."""


class Linkage(Spec):
    """Kingpins and linkage; `[steering.linkage]`."""

    kingpin_offset_m: Annotated[float, Field(ge=-0.1, le=0.3)] = 0.0
    """Distance on the ground from a kingpin's axis to its wheel's centre plane, scrub radius, outwards positive [m].
    Assumed value: none; 0.02-0.08 for compact tractors."""
    kingpin_inclination_deg: Annotated[float, Field(ge=0, le=20)] = 0.0
    """Inclination of the kingpins, tops inwards [deg]. Assumed value: none; 5-10 for tractors."""
    caster_deg: Annotated[float, Field(ge=-10, le=20)] = 0.0
    """Caster of the kingpins, tops backwards [deg]. Assumed value: none; 0-5 for tractors."""
    backlash_deg: Annotated[float, Field(ge=0, le=20)] = 0.0
    """Play between the cylinder and the wheels, from one side to the other, at the wheel [deg]. Assumed value: none;
    0.3-1 for good joints, 2-4 for worn ones."""
    friction_n_m: NonNegative = 0.0
    """Friction of kingpins and seals, both wheels together [N m]. Assumed value: none; 5-20."""

    @property
    def moved(self) -> bool:
        """Whether the kingpins are inclined or outside the wheel centres."""
        return any((self.kingpin_offset_m, self.kingpin_inclination_deg, self.caster_deg))

    def axis(self, side: int) -> tuple[float, float, float]:
        """Return the direction of a kingpin, upwards, of length above 1; `side` 1 left, -1 right, vehicle axes."""
        return -tan(radians(self.caster_deg)), -side * tan(radians(self.kingpin_inclination_deg)), 1.0

    def foot(self, side: int, radius: float) -> tuple[float, float, float]:
        """Return the point where it meets the ground from the centre of a wheel of loaded `radius` [m], vehicle axes
        [m]."""
        return radius * tan(radians(self.caster_deg)), -side * self.kingpin_offset_m, -radius

    def parked_torque(self, tractor: TractorParameters) -> float:
        """Return the torque that turns the standing front wheels on dry ground, both together [N m].

        mu W sqrt(b^2 / 8 + e^2), with the width b of the tyre and the kingpin offset e: the rule of makers of steering
        units [Eaton2006]. Friction is omitted.
        """
        arm = sqrt(tractor.front_wheel_width_m**2 / 8 + self.kingpin_offset_m**2)
        return DRY_GRIP * tractor.front_axle_load * arm


UPRIGHT = Linkage()
"""Kingpins in the wheels' centres, no play and no friction."""
