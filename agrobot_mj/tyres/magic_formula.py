"""Tyre with Pacejka's Magic Formula for firm ground, with load dependence and combined slip [Pacejka2012].

In each direction F0 = D sin(C atan(B s - E (B s - atan(B s)))), with the peak D = mu F_z and the slip stiffness K = B C
D. Friction and stiffness per load change linearly with the load: with df = (F_z - F_z0) / F_z0, mu = mu_0 (1 + mu_load
df) and K = F_z k (1 + k_load df). By default the reference load F_z0 is the static load of the wheel, also for
implements, since larger machines have larger tyres. The linear change is valid within `KNOWN_LOADS`. Camber, ply steer
and conicity are zero.

Combined slip uses similarity: each slip is normalised by D / K, and the length rho of the normalised slip vector is the
argument of both pure curves. The force, in fractions of both peaks, has the direction m (`base.force_direction`), which
changes with rho from the direction of the stiffnesses to the direction against the sliding velocity. The magnitude of
this force is m_x^2 F0_x / D_x + m_y^2 F0_y / D_y. Therefore (F_x / D_x)^2 + (F_y / D_y)^2 <= 1 for every slip, and each
force opposes its slip. The lateral slip enters rho as the angle s_y = atan(slip_y).
"""

from collections.abc import Iterator
from math import atan, pi, sin, sqrt, tan
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

from pydantic import Field

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.spec import NonNegative, Positive, Spec
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.tyres.base import CarcassTyre, Slip, Structure, TyreForce, force_direction, held_by_grip

LEAST_SHARE = 0.2
"""Minimum friction and stiffness per load, relative to their values at the reference load [-]. Assumed value."""
LINEAR = 1e-4  # Normalised slip below which the force follows from the slip stiffness, within 1e-8 [-]
NO_PEAK = 1e4  # Upper limit of B s at the peak [-]; curves with E near 1 have no peak below this limit
NEWTON_STEPS = 60  # Number of Newton steps for B s at the peak, after which the error is of the order of rounding
KNOWN_LOADS = (0.5, 2.0)
"""Range of load divided by reference load [-] in which the linear change of friction and stiffness per load is valid.
Assumed value: the load range of a tyre of one size and pressure."""


class CurveLaw(NamedTuple):
    """Coefficients of the Magic Formula for longitudinal or lateral slip. `Curve` describes each coefficient."""

    mu: float
    mu_load: float
    k: float
    k_load: float
    C: float
    E: float


@kernel
def peak_and_stiffness(F_z: float, df: float, curve: CurveLaw) -> tuple[float, float]:
    """Return peak force D [N] and slip stiffness K [N] at the load `F_z` [N], which differs by `df` [-] from F_z0."""
    D = F_z * curve.mu * max(1.0 + curve.mu_load * df, LEAST_SHARE)
    K = F_z * curve.k * max(1.0 + curve.k_load * df, LEAST_SHARE)
    return D, K


@kernel
def pure_force(s: float, D: float, K: float, C: float, E: float) -> float:
    """Return the force F0 [N] at slip `s` for peak D [N], slip stiffness K [N], shape C and curvature factor E."""
    x = K / (C * D) * s
    return D * sin(C * atan(x - E * (x - atan(x))))


class MagicLaw(NamedTuple):
    """Coefficients of the Magic Formula for one tyre."""

    F_z0: float  # Reference load [N]
    along: CurveLaw
    across: CurveLaw
    rho_peak: float  # Normalised slip at the peak of the curve that reaches its peak first [-]
    anisotropy: float  # Anisotropy of sliding friction [-], see `MagicFormula.sliding_anisotropy`

    def force(self, slip: Slip) -> TyreForce:
        """Return the force for a given combined slip. The friction factor of the ground multiplies the peak forces."""
        F_z, along, across = slip.load, self.along, self.across
        df = (F_z - self.F_z0) / self.F_z0
        D_x, K_x = peak_and_stiffness(F_z, df, along)
        D_y, K_y = peak_and_stiffness(F_z, df, across)
        D_x, D_y = slip.footing.grip * D_x, slip.footing.grip * D_y
        # similarity: the length of one normalised slip vector enters both pure curves
        n_x, n_y = slip.x * K_x / D_x, atan(slip.y) * K_y / D_y
        rho = sqrt(n_x * n_x + n_y * n_y)
        if rho < LINEAR:
            return TyreForce(-K_x * slip.x, -K_y * slip.y, 1.0, rho)
        m = force_direction(slip, (D_x, D_y), (K_x, K_y), rho, self.anisotropy)
        used = 0.0
        if m.x != 0.0:
            used += m.x * m.x / D_x * pure_force(rho * D_x / K_x, D_x, K_x, along.C, along.E)
        if m.y != 0.0:
            used += m.y * m.y / D_y * pure_force(rho * D_y / K_y, D_y, K_y, across.C, across.E)
        return TyreForce(-used * D_x * m.x, -used * D_y * m.y, held_by_grip(rho, self.rho_peak, slip.v_roll), used)

    def drag(self, slip: Slip, direction: float) -> float:
        """Return 0 [N], because firm ground has no motion resistance."""
        return 0.0


class Curve(Spec):
    """Coefficients of the Magic Formula in one direction."""

    mu: Annotated[float, Field(ge=0.01, le=10)] = 0.75
    """Maximum force divided by load, at the reference load [-]. Assumed value (range 0.6-0.9; lateral 0.5-0.6 on
    grass)."""
    mu_load: float = -0.08
    """Relative change of `mu` for a doubled load [-]. Assumed value (range -0.2 to 0)."""
    stiffness_per_load: Positive = 5.5
    """Ratio k of slip stiffness to load at the reference load [1/rad or 1]. Assumed value: lateral 3.5-6.6 at the front
    and 3.9-8.7 at the rear for cone indices of 450 to 1800 kPa [GeeCloughSommer1981]; longitudinal 5-15."""
    stiffness_load: float = -0.25
    """Relative change of `stiffness_per_load` for a doubled load [-]. Assumed value (range -0.5 to 0)."""
    shape: Annotated[float, Field(gt=0.5, le=1.9)] = 1.3
    """Shape factor C [-]. Assumed value: lateral 1.3; longitudinal 1.3-1.65 (1.65 for road tyres [Pacejka2012])."""
    curvature: Annotated[float, Field(ge=-10, le=1)] = -0.3
    """Curvature factor E [-], at most 1. Assumed value (range -2 to 1)."""

    @property
    def peak(self) -> float:
        """Normalised slip s K / D at the maximum of the curve [-], or 10 for a shape factor C without a maximum."""
        C, E = self.shape, self.curvature
        if C <= 1.0:
            return 10.0
        goal, b = tan(pi / (2 * C)), 0.0
        for _ in range(NEWTON_STEPS):
            b = min(b + (goal - b + E * (b - atan(b))) / (1 - E + E / (1 + b * b)), NO_PEAK)
        return C * b

    def law(self) -> CurveLaw:
        """Return the coefficients of the curve as a tuple for compiled functions."""
        return CurveLaw(self.mu, self.mu_load, self.stiffness_per_load, self.stiffness_load, self.shape, self.curvature)


class AxleTyre(Spec):
    """Coefficients of the tyres of one axle, for lateral and longitudinal forces."""

    reference_load_n: Positive | None = None
    """Reference load F_z0 [N]. Default: the static load of a wheel of this axle."""
    lateral: Curve = Curve()
    """Curve of the lateral force as a function of the slip angle [rad]."""
    longitudinal: Curve = Curve(mu=0.8, stiffness_per_load=10.0, shape=1.4)
    """Curve of the longitudinal force as a function of the slip ratio [-]."""

    def clamp_phrase(self, df: float) -> str:
        """Return a phrase about coefficients that `LEAST_SHARE` limits at the relative load change `df` [-], or ""."""
        curves = (self.lateral, self.longitudinal)
        held = {
            "grip": any(1 + curve.mu_load * df < LEAST_SHARE for curve in curves),
            "stiffness": any(1 + curve.stiffness_load * df < LEAST_SHARE for curve in curves),
        }
        names = " and ".join(name for name, least in held.items() if least)
        return (f"; beyond it {names} per load stay at {LEAST_SHARE:g} times the reference") if names else ""

    def law(self, static_load: float, anisotropy: float = 0.0) -> MagicLaw:
        """Return the tyre law of one tyre with the static load `static_load` [N]."""
        along, across, given = self.longitudinal, self.lateral, self.reference_load_n
        reference = static_load if given is None else given
        return MagicLaw(reference, along.law(), across.law(), min(across.peak, along.peak), anisotropy)


class MagicFormula(CarcassTyre):
    """Default tyre: a small agricultural tyre on firm ground, with the Magic Formula."""

    sized: ClassVar = {"trail_m": {"length": 1}}

    kind: Literal["magic_formula"] = "magic_formula"
    front: AxleTyre = AxleTyre(lateral=Curve(stiffness_per_load=5.3))
    """Coefficients of the front tyres. The default lateral stiffness at static load equals the bicycle model's."""
    rear: AxleTyre = AxleTyre(lateral=Curve(stiffness_per_load=6.6))
    """Coefficients of the rear tyres. The default lateral stiffness at static load equals the bicycle model's."""
    rolling_resistance: NonNegative = 0.05
    """Rolling resistance moment divided by load times rolling radius [-]. Assumed value (range 0.045-0.07)."""
    trail_m: NonNegative = 0.03
    """Pneumatic trail at small slip, the lever arm of the aligning moment [m]. Assumed value (range 0.02-0.05)."""

    def structure(self) -> Structure:
        """Return the parameters of the carcass and the contact patch."""
        return super().structure()._replace(rolling_resistance=self.rolling_resistance, trail_m=self.trail_m)

    def coefficients(self, tractor: TractorParameters) -> tuple[MagicLaw, MagicLaw]:
        """Return the coefficients of the Magic Formula for a front tyre and for a rear tyre."""
        a = self.sliding_anisotropy
        return self.front.law(tractor.front_wheel.load, a), self.rear.law(tractor.rear_wheel.load, a)

    def hints(self, tractor: TractorParameters, loads: tuple[float, float]) -> Iterator[str]:
        """Yield a message for each wheel load outside the range `KNOWN_LOADS`."""
        for load, tyre, wheel in zip(loads, (self.front, self.rear), tractor.wheels, strict=True):
            reference = tyre.law(wheel.load).F_z0
            if not KNOWN_LOADS[0] <= (share := load / reference) <= KNOWN_LOADS[1]:
                known = "grip and stiffness are valid from {:g} to {:g} times the reference load".format(*KNOWN_LOADS)
                at = f"a wheel carries {load:.0f} N, {share:.2g} times the reference load of {reference:.0f} N"
                yield f"{wheel.axle}.reference_load_n: {at}; {known}{tyre.clamp_phrase(share - 1)}"

    def of_implement(self) -> Self:
        """Return the tyre with the static load of the implement's wheels as the reference load."""
        own = {axle: getattr(self, axle).model_copy(update={"reference_load_n": None}) for axle in ("front", "rear")}
        return self.model_copy(update=own)
