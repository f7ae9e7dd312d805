from math import cos, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agrobot_mj.control.kinematic import Kinematic
from agrobot_mj.core.signals import Estimate, Reference

L_R = 0.53


def _estimate(x: float, y: float, yaw: float) -> Estimate:
    return Estimate(x, y, yaw, 0.0, 0.0, x - L_R * cos(yaw), y - L_R * sin(yaw), np.eye(3))


@given(st.floats(-3, 3), st.floats(0.1, 4), st.floats(-1, 1), st.floats(0.2, 2))
def test_kinematic_law_inverts_the_forward_model(yaw: float, u: float, gamma: float, l_r: float) -> None:
    v = gamma * l_r
    velocity = u * cos(yaw) - v * sin(yaw), u * sin(yaw) + v * cos(yaw)
    reference = Reference(1.0, 2.0, *velocity, yaw, 0.0)
    assert Kinematic().references(_estimate(1.0, 2.0, yaw), reference, l_r) == pytest.approx((u, gamma), abs=1e-12)


def test_large_errors_saturate_each_axis_of_the_correction_separately() -> None:
    law = Kinematic(saturation_m_s=0.6, gain_per_m=0.5)
    reference = Reference(1000.0, -1000.0, 0.0, 0.0, 0.0, 0.0)
    assert law.references(_estimate(0.0, 0.0, 0.0), reference, L_R) == pytest.approx((0.6, -0.6 / L_R))


def test_small_errors_give_proportional_corrections() -> None:
    law = Kinematic(saturation_m_s=0.6, gain_per_m=0.5)
    u_ref, gamma_ref = law.references(_estimate(0, 0, 0.0), Reference(0.01, 0.02, 1.0, 0.0, 0.0, 0.0), L_R)
    assert u_ref == pytest.approx(1 + 0.3 * 0.01, rel=1e-5)
    assert gamma_ref == pytest.approx(0.3 * 0.02 / L_R, rel=1e-4)


def test_tractor_left_of_the_path_steers_right() -> None:
    _, gamma_ref = Kinematic().references(_estimate(0, 1, 0.0), Reference(0, 0, 1, 0, 0, 0), L_R)
    assert gamma_ref < 0
