"""Linear tyre of [Kayacan2015]: the force is proportional to the slip, without a limit.

The lateral force follows the equation `lateralforces` for one tyre; the longitudinal force has the same form with a
slip stiffness. The lateral slip is the tangent of the slip angle. Each tyre has half the axle stiffness of the bicycle
model, so that both plants agree on level ground.
"""

from collections.abc import Iterator
from typing import ClassVar, Literal, NamedTuple

from agrobot_mj.core.spec import NonNegative, Positive
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.tyres.base import Relaxation, Slip, Structure, TyreBase, TyreForce

STIFFNESS_PER_LOAD = (2.0, 20.0)
"""Plausible range of cornering stiffness divided by load [1/rad]. Assumed limits; 3.5-9 on soil and 15 on roads."""


def unlike_a_tyre(key: str, C_alpha: float, load: float) -> str:
    """Return a message about an implausible cornering stiffness `C_alpha` [N/rad] at a `load` [N], or an empty string.

    The message begins with `key`.
    """
    low, high = STIFFNESS_PER_LOAD
    if low * load <= C_alpha <= high * load:
        return ""
    share = f"the stiffness of {C_alpha:g} N/rad is {C_alpha / load:.2g} times the load of {load:.0f} N"
    return f"{key}: {share}; the ratio of real tyres is {low:g} to {high:g}"


class LinearLaw(NamedTuple):
    """Coefficients of the linear force law of one tyre."""

    C_x: float  # Longitudinal slip stiffness [N]
    C_alpha: float  # Cornering stiffness [N/rad]

    def force(self, slip: Slip) -> TyreForce:
        """Return the force for a given slip. Friction is unlimited: bristles never slide, and no friction is used."""
        F_x = -self.C_x * slip.x
        F_l = -self.C_alpha * slip.y  # [agrobots: lateralforces]
        return TyreForce(F_x, F_l, 1.0, 0.0)

    def drag(self, slip: Slip, direction: float) -> float:
        """Return 0 [N], because firm ground has no motion resistance."""
        return 0.0


class Linear(TyreBase):
    """Linear tyre with a relaxation length."""

    sized: ClassVar = {
        **{key: {"front_load": 1} for key in ("front_cornering_stiffness_n_rad", "front_slip_stiffness_n")},
        **{key: {"rear_load": 1} for key in ("rear_cornering_stiffness_n_rad", "rear_slip_stiffness_n")},
    }

    kind: Literal["linear"] = "linear"
    front_cornering_stiffness_n_rad: Positive = 7_400.0
    """Cornering stiffness C_alpha of one front tyre [N/rad]. Assumed value (range 5.0e3-9.3e3 for cone indices of 450
    to 1800 kPa), derived from [GeeCloughSommer1981] at 1200 kPa."""
    rear_cornering_stiffness_n_rad: Positive = 15_000.0
    """Cornering stiffness C_alpha of one rear tyre [N/rad]. Assumed value (range 8.9e3-20e3), as for the front tyre."""
    front_slip_stiffness_n: Positive = 15_000.0
    """Longitudinal slip stiffness of one front tyre [N]. Assumed value: 10 times the load (range 5-15)."""
    rear_slip_stiffness_n: Positive = 25_000.0
    """Longitudinal slip stiffness of one rear tyre [N]. Assumed value: 10 times the load (range 5-15)."""
    relaxation_radii: Relaxation = 1.5
    """Relaxation length divided by free radius [-]. Assumed value (range 0.4-2), not measured on a small tractor
    tyre."""
    rolling_resistance: NonNegative = 0.0
    """Rolling resistance moment divided by load times rolling radius [-]. Assumed value: 0 (0.045-0.07 in fields)."""
    bristle_damping_s: NonNegative = 0.02
    """Damping of the carcass divided by its stiffness [s], for a relaxation length of 1.5 radii; the damping is
    proportional to the relaxation length. Assumed value (range 0.005-0.05)."""

    def hints(self, tractor: TractorParameters, loads: tuple[float, float]) -> Iterator[str]:
        """Yield a message for each cornering stiffness that is implausible at the wheel `loads` [N]."""
        given = self.front_cornering_stiffness_n_rad, self.rear_cornering_stiffness_n_rad
        for axle, load, C_alpha in zip(("front", "rear"), loads, given, strict=True):
            if line := unlike_a_tyre(f"{axle}_cornering_stiffness_n_rad", C_alpha, load):
                yield line

    def structure(self) -> Structure:
        """Return the parameters of the carcass. The tyre has no contact patch."""
        return Structure(self.relaxation_radii, self.bristle_damping_s, self.rolling_resistance)

    def coefficients(self, tractor: TractorParameters) -> tuple[LinearLaw, LinearLaw]:
        """Return the coefficients of the linear law for a front tyre and for a rear tyre."""
        return (
            LinearLaw(self.front_slip_stiffness_n, self.front_cornering_stiffness_n_rad),
            LinearLaw(self.rear_slip_stiffness_n, self.rear_cornering_stiffness_n_rad),
        )
