"""Contract of an implement: a kind describes a body at the hitch as data from which a plant builds it.

An implement is an `ImplementBase` whose `hitched` returns mass, joints, wheels, tool and shapes; kinds differ only in
these. Positions are relative to the hitch of the tractor, x ahead, y left, z up, with tractor and implement in line on
level ground [m]. The plant gives the tyres the law of the tractor's rear tyres, scaled to their size.
"""

from typing import ClassVar, Literal, NamedTuple

from agrobot_mj.core.spec import Spec
from agrobot_mj.machine.implements.draught import ToolLaw
from agrobot_mj.machine.tractor import GRAVITY, AxleWheel, TractorParameters

Place = tuple[float, float, float]
"""x ahead, y left, z up from the hitch [m]."""


class Joint(NamedTuple):
    """Hinge between tractor and implement."""

    name: str
    axis: Place
    """Unit vector of its axis."""
    at: Place
    """A point of the axis."""
    limit: float
    """Stops, in both directions [rad]."""


class Axle(NamedTuple):
    """Two wheels with tyres."""

    at: Place
    """Middle of the axle; its height is that of the wheels' centres at static load."""
    track: float
    """Distance between the wheels' centre planes [m]."""
    wheel: AxleWheel
    """Wheel of the axle."""
    slip_stiffness: float
    """Slip stiffness divided by that of the plant's law [-]."""
    rolling: float
    """Rolling resistance divided by that of the plant's law [-]."""


class DepthWheel(NamedTuple):
    """Wheel that carries the frame of a floating implement."""

    at: Place = (0.0, 0.0, 0.0)
    """Its lowest point when it just touches the ground."""
    stiffness: float = 0.0
    """Vertical stiffness; 0 for none [N/m]."""
    damping: float = 0.0
    """Vertical damping [N s/m]."""
    rolling: float = 0.0
    """Rolling resistance divided by load [-]."""


class Unevenness(NamedTuple):
    """Variation of the draught along the path."""

    share: float = 0.0
    """Standard deviation divided by the mean [-]."""
    length: float = 1.0
    """Correlation length [m]."""


class Shape(NamedTuple):
    """A box to be drawn."""

    name: str
    half: Place
    """Half sizes [m]."""
    at: Place
    """Centre."""
    paint: str
    """Material of `models/tractor.xml`."""


class HitchedBody(NamedTuple):
    """Body at the hitch."""

    mass: float
    """Mass without its wheels [kg]."""
    centre: Place
    """Centre of that mass."""
    inertia: tuple[float, float, float]
    """Moments of inertia about it, roll, pitch and yaw [kg m2]."""
    joints: tuple[Joint, ...]
    """Hinges; empty for an implement that is rigid with the tractor."""
    point: Place
    """Working point on the ground, whose cross-track error is evaluated."""
    antenna: Place | None
    """Position of the GNSS antenna; None for an antenna on the tractor."""
    axle: Axle | None = None
    depth_wheel: DepthWheel = DepthWheel()
    tool: ToolLaw | None = None
    tool_at: Place = (0.0, 0.0, 0.0)
    """Tip of the tool."""
    unevenness: Unevenness = Unevenness()
    shapes: tuple[Shape, ...] = ()


class TowedImplement(NamedTuple):
    """Implement behind the tractor, as configured in its terminal."""

    length: float = 0.0
    """Distance of the axle of a drawn implement behind the tractor's rear axle; 0 without one [m]."""
    working: bool = False
    """Whether a tool is in the soil."""
    antenna: float = 0.0
    """Distance of the GNSS antenna behind the tractor's rear axle, straight on; 0 on the tractor [m]."""


class ImplementBase(Spec):
    """Base of every implement; a kind overrides `hitched`."""

    machine: ClassVar[bool] = True
    """Whether it needs a plant with a body, which the bicycle does not have."""
    fast_step_s: ClassVar[float] = 0.005
    """Physics step of `physics = "fast"` with this implement [s]."""

    kind: str
    receiver: bool = False
    """Whether the GNSS antenna is mounted on the implement, above its working point, instead of on the tractor."""

    def hitched(self, tractor: TractorParameters) -> HitchedBody | None:
        """Return the body at this tractor's hitch; None without one. Raises ValueError if it cannot be mounted."""
        raise NotImplementedError

    def towed(self, tractor: TractorParameters) -> TowedImplement:
        """Return the lengths and state of the implement that the tractor's terminal knows."""
        hitched = self.hitched(tractor)
        if hitched is None:
            return TowedImplement()
        axle = hitched.axle if hitched.joints else None
        length = 0.0 if axle is None else tractor.hitch_behind_m - axle.at[0]
        return TowedImplement(length, hitched.tool is not None, self.receiver_behind(tractor))

    def receiver_behind(self, tractor: TractorParameters) -> float:
        """Return the distance of the antenna behind the rear axle when driving straight, 0 on the tractor [m]."""
        hitched = self.hitched(tractor)
        return 0.0 if hitched is None or hitched.antenna is None else tractor.hitch_behind_m - hitched.antenna[0]


def box_inertia(mass: float, size: Place) -> tuple[float, float, float]:
    """Return the roll, pitch and yaw inertia [kg m2] of a uniform box, length by width by height [m], about its
    centre."""
    l, w, h = size  # noqa: E741
    return mass / 12 * (w * w + h * h), mass / 12 * (l * l + h * h), mass / 12 * (l * l + w * w)


def sinking(tractor: TractorParameters, load: float, behind: float, at: float) -> float:
    """Return how far a point `at` behind the rear axle sinks under a `load` [N] at `behind` [m].

    For a rigid tractor on the vertical stiffness of its tyres.
    """
    L = tractor.wheelbase_m
    rear = load * (L + behind) / L / (2 * tractor.rear_wheel.stiffness)
    front = -load * behind / L / (2 * tractor.front_wheel.stiffness)
    return rear + (rear - front) * at / L


def wheel_loads(tractor: TractorParameters, hitched: HitchedBody | None) -> tuple[float, float]:
    """Return the static load of a front and of a rear wheel on level ground, including the implement [N]."""
    down, behind = (0.0, 0.0) if hitched is None else _on_the_hitch(hitched)
    moved = down * (tractor.hitch_behind_m + behind) / tractor.wheelbase_m
    return (tractor.front_axle_load - moved) / 2, (tractor.rear_axle_load + down + moved) / 2


def _on_the_hitch(hitched: HitchedBody) -> tuple[float, float]:
    """Return the static load that an implement puts on the tractor [N], and how far behind the hitch [m]."""
    weight, x = hitched.mass * GRAVITY, hitched.centre[0]
    if hitched.axle is not None:
        return weight * (1 - x / hitched.axle.at[0]), 0.0
    if hitched.depth_wheel.stiffness <= 0.0 or not hitched.joints:
        return weight, -x
    hinge, wheel = hitched.joints[0].at[0], hitched.depth_wheel.at[0]
    return weight * (x - wheel) / (hinge - wheel), -hinge


class NoImplement(ImplementBase):
    """Tractor without implement."""

    machine: ClassVar[bool] = False

    kind: Literal["none"] = "none"

    def hitched(self, tractor: TractorParameters) -> HitchedBody | None:
        """Always None: no implement."""
        return None
