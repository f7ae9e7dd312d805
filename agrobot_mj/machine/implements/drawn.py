"""Drawn implement with one axle, such as a trailer, a grain cart or a seeder.

The drawbar pin allows yaw, pitch and roll between stops. The two tyres use the tyre law of the tractor's rear tyres,
with separate sizes and stiffness.
"""

from math import radians, sqrt
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.machine.implements.base import Axle, HitchedBody, ImplementBase, Joint, Shape, Unevenness, box_inertia
from agrobot_mj.machine.implements.draught import Tool
from agrobot_mj.machine.tractor import GRAVITY, AxleWheel, TractorParameters

Length = Annotated[float, Field(gt=0, le=20)]
YAW, SWING = radians(85.0), radians(25.0)
"""Maximum yaw angle of the drawbar pin, and maximum pitch and roll angles, in both directions [rad]. Assumed values."""
MIDDLE = (0.0, 0.0, 0.0)
PIN = (
    Joint("hitch_yaw", (0.0, 0.0, 1.0), MIDDLE, YAW),
    Joint("hitch_pitch", (0.0, 1.0, 0.0), MIDDLE, SWING),
    Joint("hitch_roll", (1.0, 0.0, 0.0), MIDDLE, SWING),
)
"""Hinges of the drawbar pin, for yaw, pitch and roll."""


class Springs(NamedTuple):
    """Vertical stiffness and damping of a reference tyre, from which other trailer tyres are scaled.

    All tyres have the same shape and the same deflection divided by radius: the stiffness scales with load divided by
    radius. The damping ratio at the static load is constant.
    """

    load: float  # Static load of the reference tyre [N]
    radius: float  # Free radius of the reference tyre [m]
    stiffness: float  # Vertical stiffness of the reference tyre [N/m]
    damping: float  # Vertical damping of the reference tyre [N s/m]

    def under(self, load: float, radius: float, stiffness: float | None, damping: float | None) -> tuple[float, float]:
        """Return the stiffness [N/m] and damping [N s/m] of a tyre: the given value or, for None, a value scaled with
        the `load` [N] and `radius` [m]."""
        k = self.stiffness * (load / self.load) * (self.radius / radius) if stiffness is None else stiffness
        c = self.damping * sqrt(k / self.stiffness * (load / self.load)) if damping is None else damping
        return k, c


TYRE = Springs(500.0 * GRAVITY * 1.75 / 2.0 / 2, 0.3, 1.8e5, 1800.0)
"""Tyre of the default trailer. Assumed values: 4 % deflection (stiffness 1e5-3e5 N/m) and 15 % of critical damping."""


class Drawn(ImplementBase):
    """Drawn implement with one axle."""

    fast_step_s: ClassVar[float] = 0.0025

    kind: Literal["drawn"] = "drawn"
    lowered: bool = False
    """Whether the tool works in the soil."""
    mass_kg: Annotated[float, Field(ge=20, le=100000)] = 500.0
    """Mass of the implement with wheels and load [kg]. Assumed value (range 300-1000 for compact tractors)."""
    cg_behind_m: Length = 1.75
    """Distance of the centre of mass behind the hitch [m]. Assumed value: the drawbar carries 5-20 % of the weight."""
    cg_height_m: Length = 0.65
    """Height of the centre of mass above level ground [m]. Assumed value (range 0.5-1)."""
    length_m: Length = 1.8
    """Length of the body [m]. The body has the inertia of a box of the same dimensions. Assumed value (range 1.5-3)."""
    width_m: Length = 1.1
    """Width of the body [m]. Assumed value (range 1-1.5)."""
    height_m: Length = 0.6
    """Height of the body [m]. Assumed value (range 0.4-1)."""
    axle_behind_m: Length = 2.0
    """Distance of the axle behind the hitch [m]. Assumed value (range 1.5-3)."""
    track_m: Annotated[float, Field(ge=0.2, le=8)] = 1.1
    """Track width of the axle [m]. Assumed value (range 1-1.5)."""
    wheel_radius_m: Annotated[float, Field(ge=0.1, le=2)] = 0.3
    """Free radius of a wheel [m]. Assumed value for a 10.0/75-15 tyre."""
    wheel_width_m: Annotated[float, Field(ge=0.02, le=2)] = 0.2
    """Section width of a tyre [m]. Assumed value for a 10.0/75-15 tyre."""
    wheel_mass_kg: Positive = 20.0
    """Mass of one wheel [kg]. Assumed value (range 15-30)."""
    tyre_stiffness_n_m: Positive | None = None
    """Vertical stiffness of one tyre [N/m]. Default: computed from load and radius; 1.8e5 for the default implement."""
    tyre_damping_n_s_m: NonNegative | None = None
    """Vertical damping of one tyre [N s/m]. Default: 15 % of critical damping for the load on the tyre."""
    slip_stiffness_scale: Annotated[float, Field(ge=0.05, le=10)] = 1.0
    """Factor on the slip stiffness of the tyres [-], relative to the rear tyres of `plant.tyre` at the same load."""
    rolling_scale: Annotated[float, Field(ge=0, le=10)] = 1.0
    """Factor on the rolling resistance of the tyres [-], relative to `plant.tyre`."""
    tool: Tool = Tool()
    """Soil-engaging tool of the implement, used if `lowered` is true."""
    tool_behind_m: Length = 2.0
    """Distance of the tool centre behind the hitch [m]. Assumed value: the tool is at the axle."""
    antenna_height_m: Length = 2.0
    """Height of the GNSS antenna above level ground [m] if `receiver` is true. Assumed value: as on the tractor."""

    def hitched(self, tractor: TractorParameters) -> HitchedBody:
        """Return the body of the implement, with two wheels and the hinges of the drawbar pin."""
        ground, wheels = -tractor.hitch_height_m, 2 * self.wheel_mass_kg
        body = self.mass_kg - wheels
        if body <= 0:
            raise ValueError(f"implement.mass_kg: must be above the wheel mass, {wheels:g} kg, got {self.mass_kg:g}")
        wheel = self.wheel
        axle_at = (-self.axle_behind_m, 0.0, ground + wheel.radius - wheel.deflection)
        at = self.tool_behind_m if self.lowered else self.axle_behind_m
        height = (self.mass_kg * (self.cg_height_m + ground) - wheels * axle_at[2]) / body
        centre = (-(self.mass_kg * self.cg_behind_m - wheels * self.axle_behind_m) / body, 0.0, height)
        return HitchedBody(
            mass=body,
            centre=centre,
            inertia=box_inertia(body, (self.length_m, self.width_m, self.height_m)),
            joints=PIN,
            point=(-at, 0.0, ground),
            antenna=(-at, 0.0, self.antenna_height_m - tractor.hitch_height_m) if self.receiver else None,
            axle=Axle(axle_at, self.track_m, wheel, self.slip_stiffness_scale, self.rolling_scale),
            tool=self.tool.law() if self.lowered else None,
            tool_at=(-self.tool_behind_m, 0.0, ground - self.tool.depth_m),
            unevenness=Unevenness(self.tool.noise_share, self.tool.noise_length_m),
            shapes=(*self._shapes(axle_at, centre), *self._toolbar(ground)),
        )

    @property
    def wheel(self) -> AxleWheel:
        """Properties of one wheel, including its static load on level ground."""
        radius, load = self.wheel_radius_m, self.mass_kg * GRAVITY * self.cg_behind_m / self.axle_behind_m / 2
        springs = TYRE.under(load, radius, self.tyre_stiffness_n_m, self.tyre_damping_n_s_m)
        return AxleWheel("rear", radius, self.wheel_width_m, self.wheel_mass_kg, load, *springs)

    def _toolbar(self, ground: float) -> tuple[Shape, ...]:
        """Return the boxes of a toolbar with legs for images, or an empty tuple if the tool is not lowered."""
        if not self.lowered:
            return ()
        x, wide = -self.tool_behind_m, self.width_m / 2
        bar = Shape("toolbar", (0.04, wide, 0.04), (x, 0.0, ground + 0.3), "iron")
        places = (-0.8 * wide, 0.0, 0.8 * wide)
        return bar, *(
            Shape(f"leg_{i}", (0.04, 0.02, 0.15), (x, y, ground + 0.15), "iron") for i, y in enumerate(places)
        )

    def _shapes(self, axle: tuple[float, float, float], centre: tuple[float, float, float]) -> tuple[Shape, ...]:
        l, w, h = self.length_m / 2, self.width_m / 2, self.height_m / 2  # noqa: E741
        front = max(-centre[0] - l, 0.2)
        above = max(axle[2] + self.wheel_radius_m + 0.05 + h, centre[2])
        return (
            Shape("drawbar", (front / 2 + 0.1, 0.04, 0.04), (-front / 2 - 0.1, 0.0, 0.0), "iron"),
            Shape("axle_beam_i", (0.05, self.track_m / 2, 0.05), axle, "iron"),
            Shape("frame", (l, 0.06, 0.05), (centre[0], 0.0, 0.02), "iron"),
            Shape("body", (l, w, h), (centre[0], 0.0, above), "signal"),
        )
