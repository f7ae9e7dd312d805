"""Base class of tyres, and the input and output of tyre laws.

A tyre is a subclass of `TyreBase` with three members: `structure` (relaxation, damping, rolling resistance, contact
patch), `coefficients` (of the law for a front and a rear tyre, in SI units), and `native` (settings of MuJoCo's contact
if this contact replaces the law). Each law is a `TyreLaw`: a named tuple of floats whose methods `force` and `drag` are
scalar functions, compiled for the physics steps and also usable in plain Python. To add a tyre, write a module with a
tyre class and a law class, and add the tyre to the union `Tyre`.
"""

from collections.abc import Iterator
from math import sqrt
from typing import Annotated, ClassVar, NamedTuple, Protocol, Self

from pydantic import Field

from agrobot_mj.core.kernels import kernel, kernel_method
from agrobot_mj.core.spec import CarcassShare, Fraction, NonNegative, Spec
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.tyres.bearing import FIRM, Bearing

Relaxation = Annotated[float, Field(gt=0, le=10)]
"""Relaxation length divided by free radius [-]. Real tyres have a ratio of 1 to 3; higher ratios lengthen rig tests."""
ADHERES, SLIDES = 1.0, 3.0
"""Normalised slips (slip times slip stiffness divided by peak force) [-]: at 1, linear springs reach the peak force; at
3, a brush with parabolic pressure slides completely [Pacejka2012], chapter 3."""

BREAKAWAY_SPEED = 0.1
"""Rolling speed [m/s] that doubles the normalised slip at which bristles break away. Assumed value."""
VANISHING = 1e-150  # Minimum slip divided by peak force whose square does not underflow [1/N]


class Footing(NamedTuple):
    """Friction, soil strength and rolling resistance of the ground under a tyre."""

    grip: float  # Factor on the friction coefficient of the tyre [-]
    cone_index: float  # Cone index of the soil [Pa]
    rolling: float = 0.0
    """Rolling resistance of a named ground surface divided by load [-], or 0 for the rolling resistance of the tyre."""


class Slip(NamedTuple):
    """Slip, load and ground of one tyre: the input of a tyre law."""

    x: float  # Longitudinal slip [-], sliding speed divided by `v_roll`: negative when driving, positive when braking
    y: float  # Lateral slip [-], positive when sliding left; for a rolling wheel the tangent of the slip angle
    load: float  # Load normal to the ground [N]
    deflection: float  # Vertical deflection of the tyre [m]
    v_roll: float  # Reference speed of the slips [m/s], not negative: maximum of ground speed and half the rim speed
    footing: Footing
    travel: float = 1.0  # Direction of travel: 1 forward, 0 at rest, -1 in reverse, with a smooth transition [-]
    area: float = 0.0  # Contact area on yielding soil, otherwise 0 [m2]
    length: float = 0.0  # Contact length on yielding soil, otherwise 0 [m]


class TyreForce(NamedTuple):
    """Force on a wheel returned by a tyre law, with the state of the friction."""

    x: float  # Longitudinal force [N], forward positive
    y: float  # Lateral force [N], left positive
    held: float  # Fraction of the bristle (carcass) deflection that the available friction holds [-]
    used: float  # Fraction of the available friction that the tyre uses [-]


class Direction(NamedTuple):
    """Unit vector of a slip or force in the contact plane."""

    x: float  # Component forward [-]
    y: float  # Component to the left [-]


class TyreLaw(Protocol):
    """Force law of one tyre: a named tuple of floats, which are the coefficients of the law."""

    def force(self, slip: Slip) -> TyreForce:
        """Return the horizontal tyre force for a given slip, load and ground."""

    def drag(self, slip: Slip, direction: float) -> float:
        """Return the motion resistance of the soil as a forward force at the wheel centre [N], negative in forward
        travel; `direction` is the direction of travel in [-1, 1]."""


for _step in ("force", "drag"):
    kernel_method(_step)


@kernel
def slip_of_faster(slip: Slip) -> float:
    """Return the longitudinal slip relative to the faster of rim and ground [-].

    The slip is 0 for a rolling wheel, and 1 for a locked wheel or a wheel that spins at standstill. The slip follows
    from the bristle deflection. The current velocities only determine whether rim or ground is faster: a force that
    followed the rim speed directly would cause chatter of a driven wheel.
    """
    s = abs(slip.x)
    driving = -slip.travel if slip.x > 0.0 else slip.travel
    return min(s / (1.0 + max(driving, 0.0) * min(s, 1.0)), 1.0)


@kernel
def force_direction(slip: Slip, D: tuple[float, float], K: tuple[float, float], rho: float, a: float) -> Direction:
    """Return the direction (m_x, m_y) of the force under combined slip, with m_x^2 + m_y^2 = 1.

    The force is opposite to (m_x D_x, m_y D_y), with the peak forces `D` [N]. At a normalised slip `rho` below
    `ADHERES`, the contact patch acts like two springs with the slip stiffnesses `K` [N]. Above `SLIDES` the patch
    slides: with `a` = 0 the force opposes the sliding velocity; with `a` = 1 the force has the direction of maximum
    dissipation within the ellipse of the peak forces [Goyal1991]. Between both limits, the direction changes linearly
    with `rho`.
    """
    sliding = min(max((rho - ADHERES) / (SLIDES - ADHERES), 0.0), 1.0)
    ratio = D[1] / D[0]
    slides = 1.0 + a * (ratio * ratio - 1.0)
    n_x, n_y = slip.x / D[0], slip.y / D[1] * (K[1] / K[0] + sliding * (slides - K[1] / K[0]))
    length = sqrt(n_x * n_x + n_y * n_y)
    if length <= VANISHING:  # 0 in single precision
        return Direction(0.0, 0.0)
    return Direction(n_x / length, n_y / length)


@kernel
def held_by_grip(rho: float, most: float, v_roll: float) -> float:
    """Return the fraction of the bristle deflection that friction holds at the normalised slip `rho` [-].

    At rest, bristles break away at `rho` > `most`; this limit increases with the rolling speed `v_roll` [m/s].
    """
    limit = most * (1.0 + v_roll / BREAKAWAY_SPEED)
    return 1.0 if rho < limit else limit / rho


class Structure(NamedTuple):
    """Parameters of the carcass and contact patch of a tyre."""

    relaxation_radii: float = 1.5
    """Relaxation length at static load divided by free radius [-], used if `carcass_share` is 0."""
    bristle_damping_s: float = 0.02
    """Damping of the carcass divided by its stiffness [s]. Without `carcass_share` the value applies to a relaxation
    length of 1.5 radii and scales with the relaxation length."""
    rolling_resistance: float = 0.0  # Rolling resistance moment divided by load times rolling radius [-]
    patch_half_length_m: float | None = 0.0
    """Half the contact length [m]; 0 for no scrubbing moment, None for a length from the static deflection."""
    trail_m: float = 0.0  # Pneumatic trail at small slip [m]
    cone_index_pa: float = 0.0  # Cone index of ground without a cone index [Pa]; 0 for laws that use no cone index
    carcass_share: tuple[float, float] = (0.0, 0.0)
    """Longitudinal and lateral carcass stiffness divided by vertical stiffness [-]; 0 selects `relaxation_radii`."""
    bearing: Bearing = FIRM  # Parameters of soil with plastic sinkage. Default: firm ground.
    load_follows: bool = False
    """Whether the load acts at the contact patch, which the lateral force displaces, or else in the wheel plane."""


class NativeContact(NamedTuple):
    """Settings of MuJoCo's contact between wheel and ground, for a tyre without a force law."""

    friction: float = 0.8  # Sliding friction coefficient [-]
    impratio: float = 1.0  # Friction stiffness divided by normal contact stiffness [-]


class TyreBase(Spec):
    """Base class of tyres; subclasses override `structure` and `coefficients`."""

    fast_step_s: ClassVar[float] = 0.005
    """Physics step that `physics = "fast"` uses for this tyre [s]."""

    kind: str

    @property
    def native(self) -> NativeContact | None:
        """Settings of MuJoCo's contact, or None for a tyre with a force law."""
        return None

    @property
    def judged(self) -> bool:
        """Whether validation checks apply acceptance limits to this tyre, instead of only reporting results."""
        return self.native is None

    def structure(self) -> Structure:
        """Return the parameters of the carcass and the contact patch."""
        raise NotImplementedError

    def hints(self, tractor: TractorParameters, loads: tuple[float, float]) -> Iterator[str]:
        """Yield a message for each static wheel load outside the valid range of the tyre law. Default: no messages.

        `loads` are the loads of a front and of a rear wheel [N]. A message begins with a key of the tyre table.
        """
        yield from ()

    def of_implement(self) -> Self:
        """Return the tyre for implement wheels, without parameters specific to the tractor's wheel loads."""
        return self

    def coefficients(self, tractor: TractorParameters) -> tuple[TyreLaw, TyreLaw]:
        """Return the coefficients of the tyre law for a front and a rear tyre, as objects of the same class."""
        raise NotImplementedError


class CarcassTyre(TyreBase):
    """Base class of tyres whose relaxation length follows from the stiffness of the carcass."""

    carcass_lateral: CarcassShare = 0.45
    """Lateral stiffness of the carcass divided by the vertical stiffness [-]; the relaxation length is the slip
    stiffness divided by the lateral stiffness. Assumed value (range 0.3-0.6), not measured on a small tractor tyre."""
    carcass_longitudinal: CarcassShare = 0.6
    """Longitudinal stiffness of the carcass divided by the vertical stiffness [-]. Assumed value (range 0.4-0.8)."""
    bristle_damping_s: NonNegative = 0.02
    """Damping of the carcass divided by its stiffness [s]. Assumed value (range 0.005-0.05)."""
    patch_half_length_m: NonNegative | None = None
    """Half the contact length [m], or 0 for no scrubbing moment. Default: computed from radius and static
    deflection."""
    load_follows_carcass: bool = True
    """Whether the load acts at the contact patch, which the lateral force displaces. The displacement reduces the
    tip-over angle. If false, the load acts in the wheel plane."""
    sliding_anisotropy: Fraction = 0.0
    """Anisotropy of sliding friction [-]. 0: the force opposes the sliding velocity; 1: the force has the direction of
    maximum dissipation, closer to the axis of higher friction. Assumed value (up to 1 for lugs [Goyal1991])."""

    def structure(self) -> Structure:
        """Return the parameters of carcass and contact patch; subclasses add rolling resistance, trail or soil."""
        return Structure(
            bristle_damping_s=self.bristle_damping_s,
            patch_half_length_m=self.patch_half_length_m,
            carcass_share=(self.carcass_longitudinal, self.carcass_lateral),
            load_follows=self.load_follows_carcass,
        )
