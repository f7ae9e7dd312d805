"""Agricultural tyre on soil of a given cone index.

Longitudinal forces follow [Brixius1987] (ASAE D497): gross traction and motion resistance from the mobility number B_n.
Lateral forces follow [GeeCloughSommer1981] and depend on the mobility number M. W is the load [N], b the section width
[m], d the diameter [m], h the section height [m], delta the deflection [m], CI the cone index [Pa], s the slip [-] and
alpha the slip angle [rad].

    B_n = (CI b d / W) (1 + 5 delta / h) / (1 + 3 b / d)
    gross traction / W = 0.88 (1 - exp(-0.1 B_n)) (1 - exp(-7.5 s)) + 0.04
    motion resistance / W = 1 / B_n + 0.04 + 0.5 s / sqrt(B_n)     (bias ply)
    M = (CI b d / W) sqrt(delta / h) / (1 + b / (2 d))
    lateral force / W = mu (1 - exp(-B alpha)), with mu and B as functions of M (see `lateral_shape`)

The term 0.04 in both equations is the internal loss of the tyre, modelled as a rolling-resistance moment. The other
terms of the motion resistance act at the wheel centre, against the motion. The slip s is relative to the faster of rim
and ground, so that braking mirrors driving. The traction and lateral force curves are 1 - exp(-rho), with rho^2 = (7.5
s)^2 + (B alpha)^2 under combined slip. The force direction refers to fractions of both peaks
(`base.force_direction`): the force stays within the ellipse of the peaks, and a sliding tyre opposes its sliding.
Sinkage is not modelled.

On soil softer than the range of the fits, the lateral peak would increase without bound while the traction vanishes.
For M below `SOFTEST` the lateral force is therefore proportional to M.
"""

from collections.abc import Iterator
from math import atan, exp, hypot, sqrt
from typing import Literal, NamedTuple

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.spec import ConeIndex, Positive
from agrobot_mj.machine.tractor import AxleWheel, TractorParameters
from agrobot_mj.tyres.base import CarcassTyre, Slip, Structure, TyreForce, force_direction, held_by_grip, slip_of_faster

SATURATED = 3.0
"""Normalised slip rho at which bristles at rest break away [-], at 1 - exp(-3) = 95 % of the available friction."""
OWN_LOSS = 0.04  # Rolling resistance due to the internal loss of the tyre [-]. [Brixius1987].
SOFTEST = 3.0
"""Minimum lateral mobility number M for which the lateral fit is used [-]. Assumed value: at this M, B_n is about 8,
the pull of a driven tyre is half of the pull on firm soil, and the lateral peak is 0.84."""


@kernel
def mobility_number(b: float, d: float, h: float, CI: float, W: float, delta: float) -> float:
    """Return the mobility number B_n [-] of [Brixius1987] from tyre size, cone index, load and deflection."""
    return float(CI * b * d / W * (1.0 + 5.0 * delta / h) / (1.0 + 3.0 * b / d))


@kernel
def lateral_number(b: float, d: float, h: float, CI: float, W: float, delta: float) -> float:
    """Return the mobility number M [-] of [GeeCloughSommer1981] from tyre size, cone index, load and deflection."""
    return float(CI * b * d / W * sqrt(max(delta, 1e-4) / h) / (1.0 + b / (2.0 * d)))


@kernel
def lateral_shape(
    b: float, d: float, h: float, radial: float, CI: float, W: float, delta: float
) -> tuple[float, float]:
    """Return mu [-] and B [1/rad] of the lateral force W mu (1 - exp(-B alpha)) for the slip angle alpha [rad]."""
    M = lateral_number(b, d, h, CI, W, delta)
    strength, M = min(M / SOFTEST, 1.0), max(M, SOFTEST)
    if radial > 0.5:
        return 0.8 * strength, (2.79 + 0.16 * M) / 0.8
    mu = 0.61 + 0.69 / M
    return mu * strength, (2.34 + 0.088 * M) / mu


class SoilLaw(NamedTuple):
    """Dimensions and carcass type of one tyre, for the force law on soil."""

    b: float  # Section width [m]
    d: float  # Diameter [m]
    h: float  # Section height [m]
    radial: float  # Carcass type: 1 radial, 0 bias [-]
    anisotropy: float  # Anisotropy of sliding friction [-], see `Soil.sliding_anisotropy`

    def force(self, slip: Slip) -> TyreForce:
        """Return the force for a combined slip. The ground friction scales the peak forces, not the slip stiffness."""
        W, grip, CI = slip.load, slip.footing.grip, slip.footing.cone_index
        B_n = mobility_number(self.b, self.d, self.h, CI, W, slip.deflection)
        D_x = 0.88 * grip * (1.0 - exp(-0.1 * B_n)) * W
        mu, B = lateral_shape(self.b, self.d, self.h, self.radial, CI, W, slip.deflection)
        D_y, s = mu * grip * W, slip_of_faster(slip)
        rho = hypot(7.5 * s, B * atan(slip.y)) / grip
        m = force_direction(slip, (D_x, D_y), (7.5 * D_x, B * D_y), rho, self.anisotropy)
        used = 1.0 - exp(-rho)
        return TyreForce(-used * D_x * m.x, -used * D_y * m.y, held_by_grip(rho, SATURATED, slip.v_roll), used)

    def drag(self, slip: Slip, direction: float) -> float:
        """Return the motion resistance of the soil as a forward force [N], without the internal loss of the tyre."""
        s, W = slip_of_faster(slip), slip.load
        B_n = mobility_number(self.b, self.d, self.h, slip.footing.cone_index, W, slip.deflection)
        if self.radial > 0.5:
            return -direction * (W * (0.9 / B_n + 0.0325 - OWN_LOSS + 0.5 * s / sqrt(B_n)))
        return -direction * (W * (1.0 / B_n + 0.5 * s / sqrt(B_n)))


class Soil(CarcassTyre):
    """Tyres on soil of a given cone index, without sinkage."""

    kind: Literal["soil"] = "soil"
    cone_index_kpa: ConeIndex = 1200.0
    """Cone index CI of the soil [kPa]. Assumed value: 450 (tilled soil), 900 (soft), 1200 (medium) or 1800 (firm)."""
    ply: Literal["bias", "radial"] = "bias"
    """Carcass type [-], which affects motion resistance and lateral force. Default: from the size code, if given."""
    section_height_share: Positive = 0.75
    """Section height divided by section width of tyres without a size code [-]. Assumed value (range 0.7-0.85)."""

    def hints(self, tractor: TractorParameters, loads: tuple[float, float]) -> Iterator[str]:
        """Yield a message for each wheel on soil that is softer than the valid range of the force law."""
        for load, wheel in zip(loads, tractor.wheels, strict=True):
            d, b, h = 2 * wheel.radius, wheel.width, self.section_height(wheel)
            M = lateral_number(b, d, h, 1e3 * self.cone_index_kpa, load, load / wheel.stiffness)
            if M < SOFTEST:
                soft = f"the soil is too soft for {load:.0f} N on a {wheel.axle} wheel of {d:.2g} m by {b:.2g} m"
                yield f"cone_index_kpa: {soft}: the mobility number is {M:.2g}, below the valid minimum of {SOFTEST:g}"

    def structure(self) -> Structure:
        """Return the parameters of carcass and patch, with the internal loss [Brixius1987] as rolling resistance."""
        return super().structure()._replace(rolling_resistance=OWN_LOSS, cone_index_pa=1e3 * self.cone_index_kpa)

    def coefficients(self, tractor: TractorParameters) -> tuple[SoilLaw, SoilLaw]:
        """Return the dimensions and carcass type of a front tyre and of a rear tyre."""
        front, rear = (
            SoilLaw(w.width, 2 * w.radius, self.section_height(w), self.radial(w), self.sliding_anisotropy)
            for w in tractor.wheels
        )
        return front, rear

    def section_height(self, wheel: AxleWheel) -> float:
        """Return the section height of the tyre of a wheel [m], from its size code or from `section_height_share`."""
        return self.section_height_share * wheel.width if wheel.size is None else wheel.size.section_height

    def radial(self, wheel: AxleWheel) -> float:
        """Return 1 for a radial and 0 for a bias carcass, from the key `ply` or from the size code."""
        if wheel.size is None or "ply" in self.model_fields_set:
            return float(self.ply == "radial")
        return float(wheel.size.radial)
