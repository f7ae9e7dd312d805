"""Implement on the three-point hitch, fixed rigidly to the tractor or floating on a depth wheel.

The check chains of the lower links are tight: the implement follows every yaw motion of the tractor. With the linkage
`rigid` the implement also follows pitch, roll and heave; its weight, the suction of the soil and the draught load the
tractor. With `float` the implement pitches about its virtual hitch: the intersection of the lines of upper and lower
links in side view, ahead of the hitch. The tractor and the depth wheel share the weight.
"""

from math import radians
from typing import Annotated, Literal

from pydantic import Field

from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.machine.implements.base import (
    DepthWheel,
    HitchedBody,
    ImplementBase,
    Joint,
    Shape,
    Unevenness,
    box_inertia,
    sinking,
)
from agrobot_mj.machine.implements.draught import Tool
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters

Length = Annotated[float, Field(gt=0, le=20)]
TRAVEL = radians(15.0)  # Maximum angle of the floating links in both directions [rad]. Assumed value.


class Mounted(ImplementBase):
    """Implement on the three-point hitch."""

    kind: Literal["mounted"] = "mounted"
    linkage: Literal["rigid", "float"] = "rigid"
    """Mode of the lift: `rigid` fixes the position of the implement; `float` lets the depth wheel set the depth."""
    lowered: bool = True
    """Whether the tool works in the soil."""
    mass_kg: Annotated[float, Field(ge=5, le=20000)] = 110.0
    """Mass of the implement [kg]. Assumed value (range 80-250 for compact tractors)."""
    cg_behind_m: Length = 0.55
    """Distance of the centre of mass behind the hitch [m]. Assumed value (range 0.4-0.8)."""
    cg_height_m: Length = 0.45
    """Height of the centre of mass above level ground [m]. Assumed value (range 0.3-0.6)."""
    length_m: Length = 0.9
    """Length of the frame [m]. The frame has the inertia of a box of the same dimensions. Assumed value (range
    0.6-1.5)."""
    width_m: Length = 0.7
    """Width of the frame [m]. Assumed value (range 0.5-1.5)."""
    height_m: Length = 0.5
    """Height of the frame [m]. Assumed value (range 0.4-1)."""
    tool: Tool = Tool()
    """Soil-engaging tool of the implement, used if `lowered` is true."""
    tool_behind_m: Length = 0.7
    """Distance of the tool centre behind the hitch [m]. Assumed value (range 0.5-1.2)."""
    tool_left_m: Annotated[float, Field(ge=-10, le=10)] = 0.0
    """Lateral offset of the tool centre [m], positive to the left. An offset tool exerts a yaw moment."""
    antenna_height_m: Length = 2.0
    """Height of the GNSS antenna above level ground [m] if `receiver` is true. Assumed value: as on the tractor."""
    virtual_hitch_ahead_m: Length = 1.0
    """Distance of the pitch axis (virtual hitch) of a floating implement ahead of the hitch [m]. Assumed value (range
    0.5-2)."""
    depth_wheel_behind_m: Length = 0.6
    """Distance of the depth wheel behind the hitch [m]. Assumed value (range 0.3-1)."""
    depth_wheel_stiffness_n_m: Positive = 8e4
    """Vertical stiffness of the depth wheel on soil [N/m]. Assumed value (range 5e4-2e5)."""
    depth_wheel_damping_n_s_m: NonNegative = 1500.0
    """Vertical damping of the depth wheel [N s/m]. Assumed value: a quarter of critical damping."""
    depth_wheel_rolling: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Rolling resistance of the depth wheel divided by its load [-]. Assumed value (range 0.05-0.2)."""

    def hitched(self, tractor: TractorParameters) -> HitchedBody:
        """Return the body of the implement, either fixed rigidly to the tractor or hinged about a lateral axis."""
        floating, ground = self.linkage == "float", -tractor.hitch_height_m
        x, y, weight = -self.tool_behind_m, self.tool_left_m, self.mass_kg * GRAVITY
        # position control is set for the working depth: the tractor's tyres deflect under the weight
        behind = tractor.hitch_behind_m
        sunk = 0.0 if floating else sinking(tractor, weight, behind + self.cg_behind_m, behind + self.tool_behind_m)
        tip = ground + sunk - self.tool.depth_m
        carried = self._static_load(weight) if floating else 0.0
        wheel = DepthWheel(
            (-self.depth_wheel_behind_m, 0.0, ground - carried / self.depth_wheel_stiffness_n_m),
            self.depth_wheel_stiffness_n_m,
            self.depth_wheel_damping_n_s_m,
            self.depth_wheel_rolling,
        )
        across = Joint("hitch_pitch", (0.0, 1.0, 0.0), (self.virtual_hitch_ahead_m, 0.0, 0.0), TRAVEL)
        return HitchedBody(
            mass=self.mass_kg,
            centre=(-self.cg_behind_m, 0.0, self.cg_height_m - tractor.hitch_height_m),
            inertia=box_inertia(self.mass_kg, (self.length_m, self.width_m, self.height_m)),
            joints=(across,) if floating else (),
            point=(x, 0.0, ground),
            antenna=(x, 0.0, self.antenna_height_m - tractor.hitch_height_m) if self.receiver else None,
            depth_wheel=wheel if floating else DepthWheel(),
            tool=self.tool.law() if self.lowered else None,
            tool_at=(x, y, tip),
            unevenness=Unevenness(self.tool.noise_share, self.tool.noise_length_m),
            shapes=self._shapes(tractor, ground),
        )

    def _static_load(self, weight: float) -> float:
        """Return the static load on the depth wheel [N], from the moment of the weight about the virtual hitch."""
        ahead = self.virtual_hitch_ahead_m
        return weight * (ahead + self.cg_behind_m) / (ahead + self.depth_wheel_behind_m)

    def _shapes(self, tractor: TractorParameters, ground: float) -> tuple[Shape, ...]:
        bar = self.cg_height_m - tractor.hitch_height_m
        x, y, leg = -self.tool_behind_m, self.tool_left_m, (bar - ground) / 2
        wide = self.width_m / 2
        found = [
            Shape("headstock", (0.03, min(0.3, wide), 0.22), (-0.05, 0.0, bar + 0.1), "iron"),
            Shape("beam", (self.length_m / 2, 0.05, 0.05), (-self.length_m / 2, 0.0, bar), "signal"),
            Shape("toolbar", (0.04, wide, 0.04), (x, 0.0, bar), "signal"),
            Shape("leg", (0.05, 0.025, leg), (x, y, bar - leg), "iron"),
            Shape("share", (0.16, 0.08, 0.05), (x, y, ground + 0.05), "rim"),
        ]
        if self.linkage == "float":
            at = (-self.depth_wheel_behind_m, wide, ground + 0.16)
            found.append(Shape("depth_wheel", (0.16, 0.04, 0.16), at, "rubber"))
        return tuple(found)
