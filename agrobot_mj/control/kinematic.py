"""Kinematic law: position error of the CG to speed and yaw-rate references.

ENU position and velocity [m, m/s], heading psi [rad]; references u_ref [m/s] along the heading and gamma_ref
[rad/s], left positive. The law inverts the motion of a point l_r before a rear axle that rolls without slip.
Source: the paper, section III-A, after [Martins2008].
"""

from math import cos, sin, tanh

from agrobot_mj.core.signals import Estimate, Reference
from agrobot_mj.core.spec import NonNegative, Positive, Spec


class KinematicLaw(Spec):
    """Gains of the law; the paper prints none."""

    saturation_m_s: NonNegative = 0.6
    """k_s, largest velocity spent on closing an error, each axis [m/s]. Estimate."""
    gain_per_m: Positive = 0.4
    """k_e, slope of the law relative to its saturation [1/m]. Estimate."""

    def references(self, estimate: Estimate, reference: Reference, cg_to_rear_axle: float) -> tuple[float, float]:
        """Speed [m/s] and yaw-rate [rad/s] references; `cg_to_rear_axle` is l_r > 0 [m]."""
        k_s, k_e, l_r, psi = self.saturation_m_s, self.gain_per_m, cg_to_rear_axle, estimate.yaw
        vx = reference.vx + k_s * tanh(k_e * (reference.x - estimate.x))
        vy = reference.vy + k_s * tanh(k_e * (reference.y - estimate.y))
        u_ref = cos(psi) * vx + sin(psi) * vy
        gamma_ref = (-sin(psi) * vx + cos(psi) * vy) / l_r  # [agrobots: inversekinematicmodeltractor2]
        return u_ref, gamma_ref
