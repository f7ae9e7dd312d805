"""Log row of a tick: value, sign, axis and unit of every column agree with its description.

Each field of the messages below has a unique number, so that exchanged columns are detected.
"""

from math import isnan, nan, pi, radians

import numpy as np
import pytest

from agrobot_mj.core.kernels import held
from agrobot_mj.core.signals import Command, Drive, Estimate, Fix, Measurement, Reference, Truth
from agrobot_mj.simulation.columns import COLUMNS, SIGNALS, WHEEL_SIGNALS, Tick, row

P = np.array([[0.04, 0.012, 0.001], [0.012, 0.09, 0.002], [0.001, 0.002, 0.0004]])
TRUTH = Truth(
    t=12.5,
    x=100.0,
    y=50.0,
    z=0.61,
    yaw=radians(80),
    pitch=radians(2),
    roll=radians(-3),
    speed=1.3,
    lateral_speed=-0.07,
    yaw_rate=0.21,
    steer=radians(11),
    pedal=0.26,
    rear_x=99.4,
    rear_y=49.5,
    antenna=(99.3, 49.6, 2.02),
    antenna_velocity=(1.31, 0.02, -0.01),
    steer_samples=np.full(25, 0.19),
    pedal_samples=np.full(25, 0.25),
)
ESTIMATE = Estimate(
    x=100.2,
    y=50.3,
    yaw=radians(81),
    speed=1.28,
    yaw_rate=0.22,
    rear_x=99.6,
    rear_y=49.9,
    covariance=P,
    nis=1.7,
    steer_bias=radians(0.5),
)
TICK = Tick(
    truth=held(TRUTH),
    measured=Measurement(12.5, Fix(99.9, 48.8, 0.1, 1.2), 1, radians(10.4), 0.27, 0.23),
    estimate=ESTIMATE,
    reference=Reference(98.0, 53.0, 0.0, 1.25, radians(90), 0.15, 0.03),
    z_ref=0.33,
    command=Command(radians(12), 1.24),
    steer_ref=radians(11.5),
    pedal_ref=0.28,
    drive=Drive(7.1, 6.4, 0.9),
    saturated=False,
    faults=4,
    actuation=(3.1e-5, 2.4e6, 410.0),
)
DEG = pi / 180
EXPECTED = {
    **{"t": 12.5, "x_ref": 98.0, "y_ref": 53.0, "z_ref": 0.33, "yaw_ref": 90 * DEG},
    **{"curvature_ref": 0.15, "curvature_rate_ref": 0.03},
    **{"x": 100.0, "y": 50.0, "z": 0.61, "yaw": 80 * DEG, "pitch": 2 * DEG, "roll": -3 * DEG},
    **{"speed": 1.3, "lateral_speed": -0.07, "yaw_rate": 0.21, "rear_x": 99.4, "rear_y": 49.5},
    **{"x_hat": 100.2, "y_hat": 50.3, "yaw_hat": 81 * DEG, "speed_hat": 1.28, "yaw_rate_hat": 0.22},
    **{"steer_bias_hat": 0.5 * DEG, "rear_x_hat": 99.6, "rear_y_hat": 49.9},
    **{"p_xx": 0.04, "p_xy": 0.012, "p_yy": 0.09, "p_yaw": 0.0004, "position_nis": 1.7},
    **{"gnss_x": 99.9, "gnss_y": 48.8, "gnss_quality": 1.0, "faults_active": 4.0},
    **{"speed_ref": 1.24, "steer_ref": 11.5 * DEG, "steer": 11 * DEG, "steer_measured": 10.4 * DEG},
    **{"steer_saturated": 0.0, "valve_voltage": 7.1, "pedal_ref": 0.28, "pedal": 0.26, "pedal_measured": 0.27},
    **{"pedal_voltage": 6.4, "valve_flow": 3.1e-5, "steer_pressure": 2.4e6, "drive_torque": 410.0, "brake": 0.9},
    # the reference, which heads north, lies 2 m west and 3 m north of the CG: 3 m ahead, 2 m to the left
    **{"e_longitudinal": 3.0, "e_lateral": 2.0},
}
"""Expected values of columns in SI units, computed by hand from the messages above."""


def logged(tick=TICK):
    return dict(zip(COLUMNS, row(tick)[0].tolist(), strict=True))


def test_each_log_column_contains_the_quantity_of_its_name():
    found = logged()
    assert {name: found[name] for name in EXPECTED} == pytest.approx(EXPECTED)


def test_no_two_log_columns_contain_the_same_quantity():
    found = {name: value for name, value in logged().items() if not isnan(value)}
    assert found.keys() == {signal.column.name for signal in SIGNALS if signal.value}, "stages report their own"
    values = sorted(found.values())
    assert min(np.diff(values)) > 1e-9, found


@pytest.mark.parametrize("heading_deg", [0, 90, 200, -35])
@pytest.mark.parametrize(("ahead", "left"), [(1.0, 0.0), (0.0, 1.0), (-2.0, 0.5)])
def test_logged_errors_are_in_the_reference_frame_at_any_heading(heading_deg, ahead, left):
    forward = np.array([np.cos(radians(heading_deg)), np.sin(radians(heading_deg))])
    x, y = np.array([TRUTH.x, TRUTH.y]) + ahead * forward + left * np.array([-forward[1], forward[0]])
    reference = TICK.reference._replace(x=x, y=y, yaw=radians(heading_deg))
    found = logged(TICK._replace(reference=reference))
    assert (found["e_longitudinal"], found["e_lateral"]) == pytest.approx((ahead, left))


def test_nees_is_the_normalised_squared_error_of_the_rear_axle_position():
    error = np.array([TRUTH.rear_x - ESTIMATE.rear_x, TRUTH.rear_y - ESTIMATE.rear_y])
    assert logged()["position_nees"] == pytest.approx(error @ np.linalg.solve(P[:2, :2], error))
    # without correlation: one standard deviation off on each axis is 2
    sure = np.diag([0.2**2, 0.4**2, 1.0])
    assert logged(TICK._replace(estimate=ESTIMATE._replace(covariance=sure)))["position_nees"] == pytest.approx(2.0)


def test_missing_fix_is_logged_with_the_quality_no_solution():
    without = logged(TICK._replace(measured=TICK.measured._replace(fix=None, quality=0)))
    assert isnan(without["gnss_x"])
    assert isnan(without["gnss_y"])
    assert without["gnss_quality"] == 0.0


def test_saturated_steering_command_is_flagged_in_the_log():
    assert logged(TICK._replace(saturated=True))["steer_saturated"] == 1.0


def test_unavailable_bias_pressure_and_torque_are_logged_as_nan():
    found = logged(TICK._replace(estimate=ESTIMATE._replace(steer_bias=nan), actuation=(1e-5, nan, nan)))
    assert all(isnan(found[name]) for name in ("steer_bias_hat", "steer_pressure", "drive_torque"))


def test_column_units_match_the_quantities():
    """Units follow from the names: pressures are in pascal, angles in radians, and rates per second."""
    units = {signal.column.name: signal.column.unit for signal in SIGNALS}
    units |= {column.name: column.unit for column in WHEEL_SIGNALS}
    assert units["steer_pressure"] == "Pa"
    assert units["valve_flow"] == "m3/s"
    assert units["drive_torque"] == "N m"
    for name, unit in units.items():
        if "voltage" in name:
            assert unit == "V", name
        if name.startswith(("yaw", "roll", "pitch", "steer")) and "rate" not in name:
            assert unit in ("rad", "Pa", "-"), name
        if "yaw_rate" in name:
            assert unit == "rad/s", name
        if name.startswith(("load", "fx", "fy")):
            assert unit == "N", name
