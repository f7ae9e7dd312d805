"""The paper's tyre: force proportional to slip, without a limit.

Laterally this is equation lateralforces for one tyre; longitudinally the same with a slip stiffness. The lateral slip
is the tangent of the slip angle, the output of the bristle. Each tyre has half of the bicycle's axle stiffness, so that
both plants agree on level ground.
"""

from collections.abc import Iterator
from typing import ClassVar, Literal, NamedTuple

from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.tyres.base import Relaxation, Slip, Structure, TyreBase, TyreForce

STIFFNESS_PER_LOAD = (2.0, 20.0)
"""Range of cornering stiffness / load of real tyres [1/rad]. Assumed value: 3.5-9 on soil, up to 15 on roads."""


def unlike_a_tyre(key: str, C_alpha: float, load: float) -> str:
    """Return a line that begins with `key`, if no tyre under this load [N] has this cornering stiffness [N/rad]."""
    low, high = STIFFNESS_PER_LOAD
    if low * load <= C_alpha <= high * load:
        return ""
    share = f"{C_alpha:g} N/rad is {C_alpha / load:.2g} times the load of {load:.0f} N"
    return f"{key}: {share}; tyres have {low:g} to {high:g}"


class LinearLaw(NamedTuple):
    """Coefficients of one linear tyre."""

    C_x: float
    """Slip stiffness [N]."""
    C_alpha: float
    """Cornering stiffness [N/rad]."""

    def force(self, slip: Slip) -> TyreForce:
        """Return the force against the slip. Grip is unlimited: the bristle keeps its deflection, no fraction of grip
        is used."""
        F_x = -self.C_x * slip.x
        F_l = -self.C_alpha * slip.y  # [agrobots: lateralforces]
        return TyreForce(F_x, F_l, 1.0, 0.0)

    def drag(self, slip: Slip, direction: float) -> float:
        """Always 0: firm ground."""
        return 0.0


class Linear(TyreBase):
    """Linear tyre with relaxation length."""

    sized: ClassVar = {
        **{key: {"front_load": 1} for key in ("front_cornering_stiffness_n_rad", "front_slip_stiffness_n")},
        **{key: {"rear_load": 1} for key in ("rear_cornering_stiffness_n_rad", "rear_slip_stiffness_n")},
    }

    kind: Literal["linear"] = "linear"
    front_cornering_stiffness_n_rad: Positive = 7_400.0
    """C_alpha of one front tyre [N/rad]. Assumed value (5.0e3-9.3e3 from 450 to 1800 kPa cone index): 1200 by
    [GeeCloughSommer1981]."""
    rear_cornering_stiffness_n_rad: Positive = 15_000.0
    """C_alpha of one rear tyre [N/rad]. Assumed value (8.9e3-20e3), also."""
    front_slip_stiffness_n: Positive = 15_000.0
    """Longitudinal force divided by slip ratio, one front tyre [N]. Assumed value: about 10 times the load, 5-15."""
    rear_slip_stiffness_n: Positive = 25_000.0
    """Longitudinal force divided by slip ratio, one rear tyre [N]. Assumed value: about 10 times the load, 5-15."""
    relaxation_radii: Relaxation = 1.5
    """Relaxation length / free radius [-]. Assumed value (0.4-2; no measurement of a small tractor tyre found)."""
    rolling_resistance: NonNegative = 0.0
    """Rolling resistance moment / load times rolling radius [-]. Assumed value: none; in the field 0.045-0.07."""
    bristle_damping_s: NonNegative = 0.02
    """Damping of the carcass divided by its stiffness at 1.5 radii of relaxation, in proportion [s]. Assumed value
    (0.005-0.05)."""

    def hints(self, tractor: TractorParameters, loads: tuple[float, float]) -> Iterator[str]:
        """Return hints about stiffnesses outside the range of real tyres at these loads."""
        given = self.front_cornering_stiffness_n_rad, self.rear_cornering_stiffness_n_rad
        for axle, load, C_alpha in zip(("front", "rear"), loads, given, strict=True):
            if line := unlike_a_tyre(f"{axle}_cornering_stiffness_n_rad", C_alpha, load):
                yield line

    def structure(self) -> Structure:
        """Return the carcass without a contact patch."""
        return Structure(self.relaxation_radii, self.bristle_damping_s, self.rolling_resistance)

    def coefficients(self, tractor: TractorParameters) -> tuple[LinearLaw, LinearLaw]:
        """Return the law of one front and one rear tyre."""
        return (
            LinearLaw(self.front_slip_stiffness_n, self.front_cornering_stiffness_n_rad),
            LinearLaw(self.rear_slip_stiffness_n, self.rear_cornering_stiffness_n_rad),
        )
