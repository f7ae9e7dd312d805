"""Steering geometry and linkage of the front axle: kingpins, caster, play, and friction.

At static load the kingpin axis meets the ground `kingpin_offset_m` inside the centre plane of the wheel. The top of the
axis is inclined inwards and, by the caster angle, backwards. The cylinder carries the moments of the tyre forces about
this axis, caused by impacts of stones, by the weight lifted by steering, and by the lateral force at the caster trail.
With the default values, all zero, the kingpin axes pass through the wheel centres and the linkage has no play. The
bicycle plant uses only the backlash.
"""

from math import radians, sqrt, tan
from typing import Annotated

from pydantic import Field

from agrobot_mj.core.spec import NonNegative, Spec
from agrobot_mj.machine.tractor import TractorParameters

DRY_GRIP = 0.75
"""Friction coefficient of a tyre that is steered at standstill on dry ground [-]. Assumed value (range 0.6-0.8 in the
field)."""


class Linkage(Spec):
    """Kingpins and steering linkage (`[steering.linkage]`)."""

    kingpin_offset_m: Annotated[float, Field(ge=-0.1, le=0.3)] = 0.0
    """Scrub radius [m]: distance at the ground from the kingpin axis outwards to the centre plane of the wheel.
    Default: 0. Assumed value (range 0.02-0.08) for compact tractors."""
    kingpin_inclination_deg: Annotated[float, Field(ge=0, le=20)] = 0.0
    """Inward inclination of the kingpin tops [deg]. Default: 0. Assumed value (range 5-10) for tractors."""
    caster_deg: Annotated[float, Field(ge=-10, le=20)] = 0.0
    """Caster: backward inclination of the kingpin tops [deg]. Default: 0. Assumed value (range 0-5) for tractors."""
    backlash_deg: Annotated[float, Field(ge=0, le=20)] = 0.0
    """Total play between cylinder and wheels, at the wheel [deg]. Default: 0. Assumed value (range 0.3-1 if new, 2-4 if
    worn)."""
    friction_n_m: NonNegative = 0.0
    """Friction torque of both wheels' kingpins and seals [N m]. Default: 0. Assumed value (range 5-20) for tractors."""

    @property
    def moved(self) -> bool:
        """Whether the kingpins are inclined, or offset from the centres of the wheels."""
        return any((self.kingpin_offset_m, self.kingpin_inclination_deg, self.caster_deg))

    def axis(self, side: int) -> tuple[float, float, float]:
        """Return an upward vector in vehicle axes along a kingpin axis; `side` is 1 for left and -1 for right."""
        return -tan(radians(self.caster_deg)), -side * tan(radians(self.kingpin_inclination_deg)), 1.0

    def foot(self, side: int, radius: float) -> tuple[float, float, float]:
        """Return the point where a kingpin axis meets the ground, relative to the wheel centre in vehicle axes [m].

        `side` is 1 for left and -1 for right; `radius` is the loaded radius of the wheel [m].
        """
        return radius * tan(radians(self.caster_deg)), -side * self.kingpin_offset_m, -radius

    def parked_torque(self, tractor: TractorParameters) -> float:
        """Return the torque [N m] that turns both front wheels at standstill on dry ground.

        Manufacturers of steering units use the equation mu W sqrt(b^2 / 8 + e^2) [Eaton2006], with the axle load W, the
        tyre width b and the kingpin offset e. Friction of the linkage is omitted.
        """
        arm = sqrt(tractor.front_wheel_width_m**2 / 8 + self.kingpin_offset_m**2)
        return DRY_GRIP * tractor.front_axle_load * arm


UPRIGHT = Linkage()  # Kingpins through the wheel centres, without play and friction
