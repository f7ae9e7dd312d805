"""Disturbance observer with Stanley's law and LQR: estimation and compensation of unmodelled disturbances."""

from math import atan, radians, tan

import numpy as np
import pytest
from drives import MACHINE, Bend, drive

from agrobot_mj.control import Lqr, Stanley
from agrobot_mj.extensions.learners.eso import Eso

LAWS = [Eso(), Eso(inner=Lqr(integral_m_s=None))]


@pytest.mark.parametrize("speed", [1.2, -1.2, 3.0])
@pytest.mark.parametrize("law", LAWS, ids=["stanley", "lqr"])
def test_disturbance_observer_removes_the_offset_due_to_steering_bias(law: Eso, speed: float) -> None:
    bias = radians(2.0)
    d = drive(law, Bend(speed), 60.0, bias=bias)
    assert abs(d.offset[-100:].mean()) < 0.005
    names = [column.name for column in law.columns]
    found = np.mean([row[names.index("curvature_disturbance")] for row in d.reports[-100:]])
    assert atan(MACHINE.wheelbase_m * found) == pytest.approx(-bias, rel=0.1)


def test_steering_bias_causes_an_offset_without_the_observer() -> None:
    assert abs(drive(Stanley(integral_per_m=0.0), Bend(1.2), 60.0, bias=radians(2.0)).offset[-100:].mean()) > 0.02


@pytest.mark.parametrize("law", LAWS, ids=["stanley", "lqr"])
def test_estimated_disturbance_vanishes_without_a_steering_bias(law: Eso) -> None:
    d = drive(law, Bend(1.2, 0.1), 40.0)
    names = [column.name for column in law.columns]
    crab, curvature = (d.reports[-1][names.index(f"{key}_disturbance")] for key in ("heading", "curvature"))
    assert abs(crab) < radians(0.2)
    assert abs(MACHINE.wheelbase_m * tan(curvature)) < radians(0.3)
