"""An agricultural tyre on soil, by cone index.

Longitudinal after [Brixius1987] (ASAE D497): gross traction and motion resistance from the mobility number B_n. Lateral
after [GeeCloughSommer1981]. W is the load [N], b section width, d diameter, h section height, delta deflection [m],
CI cone index [Pa].

    B_n = (CI b d / W) (1 + 5 delta / h) / (1 + 3 b / d)
    gross traction / W    = 0.88 (1 - exp(-0.1 B_n)) (1 - exp(-7.5 s)) + 0.04
    motion resistance / W = 1 / B_n + 0.04 + 0.5 s / sqrt(B_n)          (bias ply)

The 0.04 in both is the tyre's own loss: here a rolling-resistance moment. The rest of the motion resistance pushes on
the wheel's centre, against its motion. The slip s is that of the faster of rim and ground, so that braking mirrors
driving. Under combined slip the forces are scaled back together to the ellipse of both peaks. Sinking is not modelled.
"""

from math import atan, exp, hypot, sqrt
from typing import Literal

import numpy as np

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import NonNegative, Positive, Spec
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.tyres.patch import Footing

BREAKAWAY_SLIP = 0.4
"""At rest the bristles break away at this slip, where 95 % of the grip is used [-]. From the 7.5 above."""
BREAKAWAY_SPEED = 0.1
"""Rolling faster than this the bristles follow the slip past it [m/s]. Estimate."""
OWN_LOSS = 0.04
"""Rolling resistance of the tyre itself [-]. [Brixius1987]."""


class Soil(Spec):
    """Tyres on soil."""

    kind: Literal["soil"] = "soil"
    cone_index_kpa: Positive = 1200.0
    """CI [kPa]: about 450 tilled, 900 soft, 1200 medium, 1800 firm. Estimate."""
    ply: Literal["bias", "radial"] = "bias"
    """Carcass: sets the motion resistance and the lateral force [-]."""
    section_height_share: Positive = 0.75
    """Section height over section width [-]. Estimate."""
    relaxation_radii: Positive = 1.5
    """Relaxation length over free radius [-]. Estimate, after [KarkeeSteward2010]."""
    bristle_damping_s: NonNegative = 0.02
    """Damping of the carcass over its stiffness at 1.5 radii of relaxation, shorter in proportion [s]. Estimate."""
    patch_half_length_m: NonNegative = 0.08
    """Half the contact length, lever of the scrubbing moment; 0 leaves it out [m]. Estimate."""

    def coefficients(self, tractor: TractorParameters) -> Array:
        """b, d, h and the ply (1 radial) of fl, fr, rl, rr, shape (4, 4)."""
        share, radial = self.section_height_share, float(self.ply == "radial")
        sizes = (
            (tractor.front_wheel_width_m, 2 * tractor.front_wheel_radius_m),
            (tractor.rear_wheel_width_m, 2 * tractor.rear_wheel_radius_m),
        )
        front, rear = ([b, d, share * b, radial] for b, d in sizes)
        return np.array([front, front, rear, rear])


@kernel
def mobility_number(coefficients: Array, CI: float, W: float, delta: float) -> float:
    """B_n [-]."""
    b, d, h = coefficients[0], coefficients[1], coefficients[2]
    return float(CI * b * d / W * (1.0 + 5.0 * delta / h) / (1.0 + 3.0 * b / d))


@kernel
def resistance(coefficients: Array, CI: float, W: float, delta: float, s: float) -> float:
    """Motion resistance less the tyre's own loss [N], at slip `s` of either sign."""
    B_n = mobility_number(coefficients, CI, W, delta)
    if coefficients[3] > 0.5:
        return W * (0.9 / B_n + 0.0325 - OWN_LOSS + 0.5 * abs(s) / sqrt(B_n))
    return W * (1.0 / B_n + 0.5 * abs(s) / sqrt(B_n))


@kernel
def lateral_shape(coefficients: Array, CI: float, W: float, delta: float) -> tuple[float, float]:
    """Peak mu [-] and B [1/rad] of F_y / W = mu (1 - exp(-B alpha))."""
    b, d, h = coefficients[0], coefficients[1], coefficients[2]
    M = CI * b * d / W * sqrt(max(delta, 1e-4) / h) / (1.0 + b / (2.0 * d))
    if coefficients[3] > 0.5:
        return 0.8, (2.79 + 0.16 * M) / 0.8
    mu = 0.61 + 0.69 / M
    return mu, (2.34 + 0.088 * M) / mu


@kernel
def drive_slip(slip_x: float) -> float:
    """Slip of the faster of rim and ground, driving positive [-], from the bristle's (sliding over ground speed)."""
    return -slip_x / (1.0 - slip_x) if slip_x < 0.0 else -slip_x


@kernel
def soil_force(
    coefficients: Array, slip_x: float, slip_y: float, load: float, deflection: float, v_roll: float, footing: Footing
) -> tuple[float, float, float, float]:
    """Forces [N] against the slips [-], the share of the bristle that the grip can hold, and the share of it in use.

    The footing's grip scales both peaks and leaves the stiffness at small slip as it is.
    """
    grip, CI = footing.grip, footing.cone_index
    B_n = mobility_number(coefficients, CI, load, deflection)
    D_x = 0.88 * grip * (1.0 - exp(-0.1 * B_n)) * load
    mu, B = lateral_shape(coefficients, CI, load, deflection)
    s, alpha = drive_slip(slip_x), atan(slip_y)
    n_x = np.sign(s) * (1.0 - exp(-7.5 * abs(s) / grip))
    n_y = -np.sign(alpha) * (1.0 - exp(-B * abs(alpha) / grip))
    used = max(1.0, hypot(n_x, n_y))
    slip = hypot(slip_x, slip_y)
    limit = BREAKAWAY_SLIP * grip * (1.0 + v_roll / BREAKAWAY_SPEED)
    n_x, n_y = n_x / used, n_y / used
    return D_x * n_x, mu * grip * load * n_y, 1.0 if slip < limit else limit / slip, hypot(n_x, n_y)
