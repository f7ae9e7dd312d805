"""Tyre on soil with plastic sinkage: ruts, multipass effect and slip sinkage.

The vertical force follows from the pressure-sinkage law of the cells below the tyre [Bekker1969], see `bearing`; the
compaction of the soil causes the motion resistance. The shear force follows [JanosiHanamoto1961] with the Mohr-Coulomb
strength. With contact area A, contact length L, combined slip s, load W, cohesion c, friction angle phi and shear
modulus K, the force is

    F = (A c + W tan phi) (1 - K / (s L) (1 - exp(-s L / K))).

The slip is relative to the faster of rim and ground; `base.force_direction` gives the direction of the force. On ground
without a soil memory (a test rig) only the tyre deflects.
"""

from collections.abc import Iterator
from math import exp, hypot, radians, sqrt, tan
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import AfterValidator, Field

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.spec import HUGE, NonNegative, Positive
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.tyres.base import CarcassTyre, Slip, Structure, TyreForce, force_direction, held_by_grip, slip_of_faster
from agrobot_mj.tyres.bearing import Bearing
from agrobot_mj.tyres.soil import OWN_LOSS

STIFFEST_MPA_M = 1e4
"""Maximum soil stiffness [MPa/m]; with stiffer soil, load and resistance would depend on the physics step."""
DEEPEST = 1 / 3
"""Maximum sinkage divided by the wheel radius [-] for which the closed-form solution is valid [Bekker1969]."""
SHEARED = 20.0
"""Shear displacement at which resting bristles break away, relative to K [-]; the force is 95 % of the strength."""


@kernel
def shear_strength_share(j: float) -> float:
    """Return the used fraction of shear strength [-]; `j` is the displacement at the patch end divided by modulus K."""
    if j < 1e-3:
        return 0.5 * j - j * j / 6.0
    return 1.0 - (1.0 - exp(-j)) / j


def rebound_in_range(mpa_m: float) -> float:
    """Return the soil stiffness `mpa_m` [MPa/m]. Raises ValueError for values outside 1 to `STIFFEST_MPA_M`."""
    if not 1.0 <= mpa_m <= STIFFEST_MPA_M:
        why = "stiffer soil rebounds within one physics step; use a tyre law for firm ground instead"
        raise ValueError(f"must be from 1 to {STIFFEST_MPA_M:g} MPa/m ({why}), got {mpa_m:g}")
    return mpa_m


class RutsLaw(NamedTuple):
    """Soil strength and tyre dimensions for the force law of one tyre."""

    cohesion: float  # Cohesion c [Pa]
    tan_phi: float  # Tangent of the friction angle [-]
    K: float  # Shear deformation modulus K: displacement at 63 % of the strength [m]
    radius: float  # Free radius of the tyre [m]
    crown: float  # Crown radius of the tyre [m]
    anisotropy: float  # Anisotropy of sliding friction [-], see `Ruts.sliding_anisotropy`

    def force(self, slip: Slip) -> TyreForce:
        """Return the shear force of the soil for a given combined slip."""
        L, A = slip.length, slip.area
        if L <= 0.0:  # elliptical patch on ground without sinkage
            L = 2.0 * sqrt(2.0 * self.radius * slip.deflection)
            A = 0.785 * L * 2.0 * sqrt(2.0 * self.crown * slip.deflection)
        H = slip.footing.grip * (A * self.cohesion + slip.load * self.tan_phi)
        j = hypot(slip_of_faster(slip), slip.y) * L / self.K
        m = force_direction(slip, (H, H), (1.0, 1.0), j, self.anisotropy)
        used = shear_strength_share(j)
        return TyreForce(-used * H * m.x, -used * H * m.y, held_by_grip(j, SHEARED, slip.v_roll), used)

    def drag(self, slip: Slip, direction: float) -> float:
        """Return 0 [N], because the compaction resistance is a separate force (see `bearing`)."""
        return 0.0


class Ruts(CarcassTyre):
    """Tyres on plastic soil, in which ruts remain."""

    fast_step_s: ClassVar[float] = 0.002

    kind: Literal["ruts"] = "ruts"
    k_c_kn: NonNegative = 5.27
    """Cohesive modulus k_c [kN/m^(n+1)]. Assumed value (range 0-20): sandy loam with 15 % moisture, from [Wong2008]."""
    k_phi_kn: Positive = 1515.0
    """Frictional modulus k_phi [kN/m^(n+2)]. Assumed value (range 200-5000) for the same soil as k_c."""
    exponent: Annotated[float, Field(ge=0.1, le=2)] = 0.7
    """Exponent n of the sinkage [-]. Assumed value (range 0.1-1.2) for the same soil as k_c."""
    cohesion_kpa: NonNegative = 1.72
    """Cohesion c [kPa]. Assumed value (range 0-70) for the same soil as k_c."""
    friction_deg: Annotated[float, Field(gt=0, le=60)] = 29.0
    """Angle of internal friction phi [deg]. Assumed value (range 10-38) for the same soil as k_c."""
    shear_m: Annotated[float, Field(ge=0.001, le=0.2)] = 0.015
    """Shear deformation modulus K [m]. Assumed value (0.01 for firm sand to 0.025 for loose soil)."""
    rebound_mpa_m: Annotated[float, Field(gt=0, le=HUGE), AfterValidator(rebound_in_range)] = 200.0
    """Elastic stiffness of the soil [MPa/m]. Assumed value (range 40-400), as in the soils of Project Chrono."""
    multipass: Annotated[float, Field(ge=1, le=20)] = 3.0
    """Exponent a of the multipass law [-]: N equal passes cause N^(1/a) times the sinkage of one pass. Assumed value
    (2-3 for loose soil, 3-5 for firm soil [Abebe1989])."""
    crown_share: Annotated[float, Field(ge=0.2, le=5)] = 1.0
    """Radius of the tread crown divided by the tyre width [-]. Assumed value (range 0.7-2)."""
    cell_m: Annotated[float, Field(ge=0.02, le=0.1)] = 0.05
    """Side length of the soil cells [m]; half the length needs four times the computing time. Assumed value
    (0.025-0.06), with four cells across a front tyre."""

    @property
    def judged(self) -> bool:
        """Whether validation checks apply acceptance limits: always false, because the theories assume firm ground."""
        return False

    def hints(self, tractor: TractorParameters, loads: tuple[float, float]) -> Iterator[str]:
        """Yield a message for each wheel that would sink deeper than the valid range of the pressure-sinkage law."""
        n = self.exponent
        for load, wheel in zip(loads, tractor.wheels, strict=True):
            R, b = wheel.radius, wheel.width
            k = 1e3 * (self.k_c_kn / b + self.k_phi_kn)
            sunk = (3 * load / ((3 - n) * b * k * sqrt(2 * R))) ** (2 / (2 * n + 1))
            if sunk > DEEPEST * R:
                deep = f"would sink by {sunk:.2g} m under {load:.0f} N"
                yield f"k_phi_kn: a rigid {wheel.axle} wheel {deep}, more than a third of its radius of {R:.2g} m"

    def structure(self) -> Structure:
        """Return the parameters of carcass and patch, with the internal loss [Brixius1987] as rolling resistance."""
        bearing = Bearing(
            k_c=1e3 * self.k_c_kn,
            k_phi=1e3 * self.k_phi_kn,
            n=self.exponent,
            rebound=1e6 * self.rebound_mpa_m,
            multipass=self.multipass,
            crown_share=self.crown_share,
            cell=self.cell_m,
        )
        return super().structure()._replace(rolling_resistance=OWN_LOSS, bearing=bearing)

    def coefficients(self, tractor: TractorParameters) -> tuple[RutsLaw, RutsLaw]:
        """Return the soil strength and tyre dimensions for a front tyre and for a rear tyre."""
        c, slope = 1e3 * self.cohesion_kpa, tan(radians(self.friction_deg))
        front, rear = (
            RutsLaw(c, slope, self.shear_m, wheel.radius, self.crown_share * wheel.width, self.sliding_anisotropy)
            for wheel in tractor.wheels
        )
        return front, rear
