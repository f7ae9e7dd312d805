"""The contract of a tyre: what every law declares about itself, and the records that laws and wheels exchange.

A tyre is a `TyreBase` with three steps: `structure` (relaxation, damping, rolling resistance, contact patch),
`coefficients` (the law's numbers for front and rear, in SI) and `native` (MuJoCo makes the force instead). The
coefficients are a `TyreLaw`: a named tuple of floats whose methods `force` and `drag` are plain scalar functions,
compiled for the tick and usable as they stand. A new tyre is one file with both classes, and its name in the union
`Tyre`.
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
"""Relaxation length divided by free radius [-]: 1 to 3 for tyres; test times on the rig are proportional to it."""
ADHERES, SLIDES = 1.0, 3.0
"""Slip divided by (peak force / stiffness) at which springs reach the peak, and at which a brush with parabolic
pressure slides completely [-]. [Pacejka2012] chapter 3."""

BREAKAWAY_SPEED = 0.1
"""Rolling speed above which the bristles follow the slip past the peak; at rest they break off [m/s]. Assumed value."""
VANISHING = 1e-150
"""Minimum slip divided by peak force whose square does not underflow [1/N]."""


class Footing(NamedTuple):
    """Properties of the ground under a wheel."""

    grip: float
    """Scale of the friction [-]."""
    cone_index: float
    """Cone index of the soil [Pa]."""


class Slip(NamedTuple):
    """State of one tyre on the ground: all that a law needs to know."""

    x: float
    """Longitudinal slip, sliding speed over `v_roll`: negative driving, positive braking, in forward travel [-]."""
    y: float
    """Lateral slip, positive sliding left; of a wheel that rolls the tangent of its slip angle [-]."""
    load: float
    """Load normal to the ground [N]."""
    deflection: float
    """Vertical deflection [m]."""
    v_roll: float
    """Reference speed of the slips, not negative: the ground speed, or half the rim speed if larger [m/s]."""
    footing: Footing
    travel: float = 1.0
    """Direction of travel, from 1 ahead through 0 at rest to -1 in reverse [-]."""
    area: float = 0.0
    """Contact area on soil that sinks, else 0 [m2]."""
    length: float = 0.0
    """Contact length on soil that sinks, else 0 [m]."""


class TyreForce(NamedTuple):
    """Force that a law gives for a `Slip`."""

    x: float
    """Force forward [N]."""
    y: float
    """Force to the left [N]."""
    held: float
    """Fraction of the bristle's deflection that the grip can hold [-]."""
    used: float
    """Fraction of the grip in use [-]."""


class Direction(NamedTuple):
    """Direction of a slip or force in a tyre's plane."""

    x: float
    """Forward [-]."""
    y: float
    """To the left [-]."""


class TyreLaw(Protocol):
    """Coefficients of one tyre as a named tuple of floats, with its force law."""

    def force(self, slip: Slip) -> TyreForce:
        """Return the force of the tyre against its slip."""

    def drag(self, slip: Slip, direction: float) -> float:
        """Return the force of the ground's resistance on the wheel's centre [N]; `direction` of travel in [-1, 1]."""


for _step in ("force", "drag"):
    kernel_method(_step)


@kernel
def slip_of_faster(slip: Slip) -> float:
    """Return the longitudinal slip relative to the faster of rim and ground speed: 0 rolling, 1 spinning on the spot or
    locked [-].

    It follows from the deflection of the bristle. The present velocities only determine which of the two is faster: a
    force that follows the rim speed directly would let a driven wheel chatter.
    """
    s = abs(slip.x)
    driving = -slip.travel if slip.x > 0.0 else slip.travel
    return min(s / (1.0 + max(driving, 0.0) * min(s, 1.0)), 1.0)


@kernel
def force_direction(slip: Slip, D: tuple[float, float], K: tuple[float, float], rho: float, a: float) -> Direction:
    """Return the direction of the force under combined slip, as fractions of both peaks `D` [N]: m_x^2 + m_y^2 = 1.

    A patch that adheres makes the force of two springs, (K_x slip_x, K_y slip_y) with the slip stiffnesses `K` [N]. One
    that slides opposes the sliding velocity, for `a` = 0, or takes the most power that the ellipse allows, for `a` = 1
    (its normal is the sliding direction [Goyal1991]). From one to the other the direction turns between `ADHERES` and
    `SLIDES` of `rho`, the slip over peak over stiffness.
    """
    sliding = min(max((rho - ADHERES) / (SLIDES - ADHERES), 0.0), 1.0)
    ratio = D[1] / D[0]
    slides = 1.0 + a * (ratio * ratio - 1.0)
    n_x, n_y = slip.x / D[0], slip.y / D[1] * (K[1] / K[0] + sliding * (slides - K[1] / K[0]))
    length = sqrt(n_x * n_x + n_y * n_y)
    if length <= VANISHING:  # single precision has 0 for it
        return Direction(0.0, 0.0)
    return Direction(n_x / length, n_y / length)


@kernel
def held_by_grip(rho: float, most: float, v_roll: float) -> float:
    """Return the fraction of the bristle deflection held by grip at a slip `rho`: at rest the bristle breaks away above
    `most`.

    While rolling, the deflection follows the slip above the limit.
    """
    limit = most * (1.0 + v_roll / BREAKAWAY_SPEED)
    return 1.0 if rho < limit else limit / rho


class Structure(NamedTuple):
    """Carcass and contact patch around a law."""

    relaxation_radii: float = 1.5
    """Relaxation length divided by free radius at the static load, for `carcass_share` 0 [-]."""
    bristle_damping_s: float = 0.02
    """Damping of the carcass divided by its stiffness; without `carcass_share` at 1.5 radii of relaxation, otherwise in
    proportion [s]."""
    rolling_resistance: float = 0.0
    """Rolling resistance moment divided by load times rolling radius [-]."""
    patch_half_length_m: float | None = 0.0
    """Half the contact length, lever arm of the scrubbing moment; 0 for no moment, None for the length at static
    deflection [m]."""
    trail_m: float = 0.0
    """Pneumatic trail at small slip; 0 without trail [m]."""
    cone_index_pa: float = 0.0
    """Cone index for ground that does not give one; 0 for laws without [Pa]."""
    carcass_share: tuple[float, float] = (0.0, 0.0)
    """Longitudinal and lateral stiffness of the carcass / the vertical stiffness; 0 to use `relaxation_radii` [-]."""
    bearing: Bearing = FIRM
    """Soil that sinks below the wheels and remembers it; firm ground by default."""


class NativeContact(NamedTuple):
    """Settings of MuJoCo's own contact between wheels and ground."""

    friction: float = 0.8
    """Sliding friction coefficient [-]."""
    impratio: float = 1.0
    """Friction stiffness divided by normal contact stiffness [-]."""


class TyreBase(Spec):
    """Base of every tyre."""

    fast_step_s: ClassVar[float] = 0.005
    """Physics step of `physics = "fast"` on this tyre [s]."""

    kind: str

    @property
    def native(self) -> NativeContact | None:
        """MuJoCo's contact if it replaces the law; None for a tyre with a force law."""
        return None

    @property
    def judged(self) -> bool:
        """Whether theory predicts this tyre, so that a validation check may evaluate it; else numbers are reported."""
        return self.native is None

    def structure(self) -> Structure:
        """Return the carcass and contact patch."""
        raise NotImplementedError

    def hints(self, tractor: TractorParameters, loads: tuple[float, float]) -> Iterator[str]:
        """Return lines, key first, for static loads of a front and a rear wheel [N] outside the range of the law.

        Keys are relative to the tyre table. Default: none.
        """
        yield from ()

    def of_implement(self) -> Self:
        """Return the tyre law for implement wheels, without data measured at the tractor's wheel loads."""
        return self

    def coefficients(self, tractor: TractorParameters) -> tuple[TyreLaw, TyreLaw]:
        """Return the law of one front and one rear tyre; both of the same class."""
        raise NotImplementedError


class CarcassTyre(TyreBase):
    """Base of tyres whose relaxation follows from the stiffness of their carcass."""

    carcass_lateral: CarcassShare = 0.45
    """Lateral stiffness of the carcass divided by the vertical one; the relaxation length is slip stiffness divided by
    lateral stiffness [-]. Assumed value: 0.3-0.6 for pneumatic tyres, none measured on a small tractor."""
    carcass_longitudinal: CarcassShare = 0.6
    """Longitudinal stiffness of the carcass divided by the vertical one [-]. Assumed value: 0.4-0.8."""
    bristle_damping_s: NonNegative = 0.02
    """Damping of the carcass divided by its stiffness [s]. Assumed value (0.005-0.05)."""
    patch_half_length_m: NonNegative | None = None
    """Half the contact length, lever arm of the scrubbing moment; 0 for no moment [m]. Default: from radius and static
    deflection of each axle's tyres."""
    sliding_anisotropy: Fraction = 0.0
    """Direction of a sliding tyre's force: 0 opposite to the sliding velocity, 1 the direction of maximum dissipation,
    turned towards higher grip [-]. Assumed value; 1 is the bound for lugs, by [Goyal1991]."""

    def structure(self) -> Structure:
        """Return the carcass and contact patch; a kind adds its other parts."""
        return Structure(
            bristle_damping_s=self.bristle_damping_s,
            patch_half_length_m=self.patch_half_length_m,
            carcass_share=(self.carcass_longitudinal, self.carcass_lateral),
        )
