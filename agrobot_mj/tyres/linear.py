"""The paper's tyre: force proportional to slip, without a limit.

Laterally this is equation lateralforces for one tyre; longitudinally the same with a slip stiffness. The slip
angle enters as its tangent, which is what the bristle yields. Half of the bicycle's axle stiffness a tyre, so that both
plants agree on level ground.
"""

from typing import Literal

import numpy as np

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import NonNegative, Positive, Spec


class Linear(Spec):
    """Linear tyre with relaxation length."""

    kind: Literal["linear"] = "linear"
    front_cornering_stiffness_n_rad: Positive = 7_400.0
    """C_alpha of one front tyre [N/rad]. Estimate: [GeeCloughSommer1981] at 1200 kPa cone index."""
    rear_cornering_stiffness_n_rad: Positive = 15_000.0
    """C_alpha of one rear tyre [N/rad]. Estimate: as the front."""
    front_slip_stiffness_n: Positive = 15_000.0
    """Force over slip ratio, one front tyre [N]. Estimate: about 10 times the load."""
    rear_slip_stiffness_n: Positive = 25_000.0
    """Force over slip ratio, one rear tyre [N]. Estimate: about 10 times the load."""
    relaxation_radii: Positive = 1.5
    """Relaxation length over free radius [-]. Estimate, after [KarkeeSteward2010]."""
    rolling_resistance: NonNegative = 0.0
    """Moment over load and rolling radius [-]. None, as in the bicycle; in the field 0.045-0.07."""
    bristle_damping_s: NonNegative = 0.02
    """Damping of the carcass over its stiffness at 1.5 radii of relaxation, shorter in proportion [s]. Estimate."""

    def coefficients(self) -> Array:
        """Slip stiffness and cornering stiffness of fl, fr, rl, rr, shape (4, 2)."""
        front = (self.front_slip_stiffness_n, self.front_cornering_stiffness_n_rad)
        rear = (self.rear_slip_stiffness_n, self.rear_cornering_stiffness_n_rad)
        return np.array([front, front, rear, rear])


@kernel
def linear_force(coefficients: Array, slip_x: float, slip_y: float) -> tuple[float, float, float, float]:
    """Forces [N] against the slips [-], the share of the bristle that the grip can hold, and the share of it in use.

    Grip has no limit here: the whole bristle is held, and no share of it is ever in use.
    """
    C_x, C_alpha = coefficients[0], coefficients[1]
    F_x = -C_x * slip_x
    F_l = -C_alpha * slip_y  # [agrobots: lateralforces]
    return F_x, F_l, 1.0, 0.0
