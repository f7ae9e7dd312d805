"""Base class of implements, and the data from which a plant builds the model of the body at the hitch.

`ImplementBase.hitched` returns mass, joints, wheels, tool and shapes; the kinds of implements differ only in these
data. Positions are relative to the tractor's hitch (x ahead, y left, z up) [m], with the tractor and implement in line
on level ground. The tyres of the implement use the law of the tractor's rear tyres, scaled to their size.
"""

from typing import ClassVar, Literal, NamedTuple

from agrobot_mj.core.spec import Spec
from agrobot_mj.machine.implements.draught import ToolLaw
from agrobot_mj.machine.tractor import GRAVITY, AxleWheel, TractorParameters

Place = tuple[float, float, float]  # Position relative to the hitch: x ahead, y left, z up [m]


class Joint(NamedTuple):
    """Hinge between tractor and implement."""

    name: str
    axis: Place  # Unit vector of the hinge axis [-]
    at: Place  # Point on the hinge axis [m], relative to the hitch of the tractor
    limit: float  # Maximum angle of the hinge in both directions [rad]


class Axle(NamedTuple):
    """Axle of an implement, with two equal wheels."""

    at: Place  # Midpoint between the wheel centres at static load [m], relative to the hitch of the tractor
    track: float  # Distance between the centre planes of the wheels [m]
    wheel: AxleWheel  # Properties of each wheel
    slip_stiffness: float  # Factor on the slip stiffness of the plant's tyre law [-]
    rolling: float  # Factor on the rolling resistance of the plant's tyre law [-]


class DepthWheel(NamedTuple):
    """Depth wheel, which carries the frame of a floating implement."""

    at: Place = (0.0, 0.0, 0.0)  # Lowest point of the unloaded wheel [m], relative to the hitch of the tractor
    stiffness: float = 0.0  # Vertical stiffness of the wheel [N/m], or 0 if there is no depth wheel
    damping: float = 0.0  # Vertical damping of the wheel [N s/m]
    rolling: float = 0.0  # Rolling resistance divided by the load of the wheel [-]


class Unevenness(NamedTuple):
    """Random variation of the draught along the path."""

    share: float = 0.0  # Standard deviation of the draught divided by its mean [-]
    length: float = 1.0  # Correlation length of the draught along the path [m]


class Shape(NamedTuple):
    """Box that represents a part of an implement in images."""

    name: str
    half: Place  # Half lengths of the edges of the box [m]
    at: Place  # Position of the centre of the box [m], relative to the hitch of the tractor
    paint: str  # Name of the material of the box in `models/tractor.xml`


class HitchedBody(NamedTuple):
    """Body of an implement attached to the hitch of the tractor."""

    mass: float  # Mass of the implement without wheels [kg]
    centre: Place  # Centre of mass of the implement without wheels [m], relative to the hitch of the tractor
    inertia: tuple[float, float, float]  # Moments of inertia about the centre of mass: roll, pitch and yaw [kg m2]
    joints: tuple[Joint, ...]
    """Hinges between tractor and implement, or an empty tuple for an implement fixed rigidly to the tractor."""
    point: Place  # Working point on the ground [m], relative to the hitch, for which the cross-track error is evaluated
    antenna: Place | None
    """Position of the GNSS antenna relative to the hitch [m], or None for an antenna on the tractor."""
    axle: Axle | None = None
    depth_wheel: DepthWheel = DepthWheel()
    tool: ToolLaw | None = None
    tool_at: Place = (0.0, 0.0, 0.0)  # Position of the tool tip [m], relative to the hitch of the tractor
    unevenness: Unevenness = Unevenness()
    shapes: tuple[Shape, ...] = ()


class TowedImplement(NamedTuple):
    """Dimensions and state of an implement, as entered by the operator in the terminal of the tractor."""

    length: float = 0.0
    """Distance of the implement axle behind the rear axle of the tractor [m]; 0 if there is no drawn implement."""
    working: bool = False  # Whether the tool is in the soil
    antenna: float = 0.0
    """Distance of the GNSS antenna behind the rear axle when driving straight [m]; 0 for an antenna on the tractor."""


class ImplementBase(Spec):
    """Base class of implements; subclasses override `hitched`, which returns the body of the implement."""

    machine: ClassVar[bool] = True
    """Whether the implement requires a plant with rigid bodies, such as MuJoCo, instead of the bicycle plant."""
    fast_step_s: ClassVar[float] = 0.005
    """Physics step that `physics = "fast"` uses with this implement [s]."""

    kind: str
    receiver: bool = False
    """Whether the GNSS antenna is on the implement, above the working point, instead of on the tractor."""

    def hitched(self, tractor: TractorParameters) -> HitchedBody | None:
        """Return the body of the implement, or None without implement. Raises ValueError for an impossible mounting."""
        raise NotImplementedError

    def towed(self, tractor: TractorParameters) -> TowedImplement:
        """Return the data of the implement as entered by the operator in the terminal of the tractor."""
        hitched = self.hitched(tractor)
        if hitched is None:
            return TowedImplement()
        axle = hitched.axle if hitched.joints else None
        length = 0.0 if axle is None else tractor.hitch_behind_m - axle.at[0]
        return TowedImplement(length, hitched.tool is not None, self.receiver_behind(tractor))

    def receiver_behind(self, tractor: TractorParameters) -> float:
        """Return the distance of the antenna behind the rear axle when driving straight [m]; 0 if on the tractor."""
        hitched = self.hitched(tractor)
        return 0.0 if hitched is None or hitched.antenna is None else tractor.hitch_behind_m - hitched.antenna[0]


def box_inertia(mass: float, size: Place) -> tuple[float, float, float]:
    """Return the roll, pitch and yaw inertia [kg m2] of a uniform box about its centre.

    `size` is the length, width and height of the box [m].
    """
    l, w, h = size  # noqa: E741
    return mass / 12 * (w * w + h * h), mass / 12 * (l * l + h * h), mass / 12 * (l * l + w * w)


def sinking(tractor: TractorParameters, load: float, behind: float, at: float) -> float:
    """Return the downward motion [m] of a point of the tractor whose tyres deflect under a vertical `load` [N].

    `at` and `behind` are the distances of the point and of the load behind the rear axle [m].
    """
    L = tractor.wheelbase_m
    rear = load * (L + behind) / L / (2 * tractor.rear_wheel.stiffness)
    front = -load * behind / L / (2 * tractor.front_wheel.stiffness)
    return rear + (rear - front) * at / L


def wheel_loads(tractor: TractorParameters, hitched: HitchedBody | None) -> tuple[float, float]:
    """Return the static loads [N] of one front and one rear wheel on level ground, with the implement attached."""
    down, behind = (0.0, 0.0) if hitched is None else _on_the_hitch(hitched)
    moved = down * (tractor.hitch_behind_m + behind) / tractor.wheelbase_m
    return (tractor.front_axle_load - moved) / 2, (tractor.rear_axle_load + down + moved) / 2


def _on_the_hitch(hitched: HitchedBody) -> tuple[float, float]:
    """Return the vertical load of an implement on the tractor [N], and the distance of the load behind the hitch
    [m]."""
    weight, x = hitched.mass * GRAVITY, hitched.centre[0]
    if hitched.axle is not None:
        return weight * (1 - x / hitched.axle.at[0]), 0.0
    if hitched.depth_wheel.stiffness <= 0.0 or not hitched.joints:
        return weight, -x
    hinge, wheel = hitched.joints[0].at[0], hitched.depth_wheel.at[0]
    return weight * (x - wheel) / (hinge - wheel), -hinge


class NoImplement(ImplementBase):
    """Tractor without an implement."""

    machine: ClassVar[bool] = False

    kind: Literal["none"] = "none"

    def hitched(self, tractor: TractorParameters) -> HitchedBody | None:
        """Return None, because there is no implement."""
        return None
