"""Default values derived from the size of a machine, and hints for values that do not fit the size."""

from math import sqrt
from operator import attrgetter

import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.walk import keys
from agrobot_mj.machine import Cylinder, Linkage, TractorParameters
from agrobot_mj.machine.implements import Drawn, Mounted
from agrobot_mj.machine.implements.base import wheel_loads
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.scenario.schema import Scenario

COMPACT = TractorParameters()
LARGE = TractorParameters(
    mass_kg=3600, front_load_fraction=0.44, wheelbase_m=2.3, front_wheel_radius_m=0.55, rear_wheel_radius_m=0.75
)
G = 9.81


def test_default_tyres_of_a_light_tractor_have_the_minimum_pressure():
    """Stiffness k = 0.00028 p sqrt((1.03 - 0.004 a) b d) + 3.45 [kgf/mm], for p = 60 kPa, a in %, and b and d in mm."""
    for wheel, b, d in ((COMPACT.front_wheel, 160, 560), (COMPACT.rear_wheel, 240, 840)):
        assert wheel.stiffness == pytest.approx(9806.65 * (0.00028 * 60 * sqrt((1.03 - 0.3) * b * d) + 3.45))
        assert wheel.damping == pytest.approx(2 * 0.15 * sqrt(wheel.stiffness * wheel.load / G))


def test_default_tyres_of_a_large_tractor_deflect_by_a_fifth_of_height():
    """The section height is three quarters of the width."""
    for wheel in TractorParameters(mass_kg=6000.0, wheelbase_m=2.8).wheels:
        assert wheel.deflection == pytest.approx(0.2 * 0.75 * wheel.width)
        assert 0.085 < wheel.deflection / wheel.radius < 0.1
    assert TractorParameters(rear_tyre_pressure_bar=1.2).rear_wheel.stiffness > 1.5 * COMPACT.rear_wheel.stiffness


def test_tyre_damping_ratio_is_independent_of_machine_size():
    def share(p):
        return p.rear_wheel.damping / (2 * sqrt(p.rear_wheel.stiffness * p.rear_wheel.load / G))

    stiff = LARGE.model_copy(update={"rear_tyre_stiffness_n_m": 9e5})
    assert share(LARGE) == pytest.approx(share(COMPACT))
    assert share(stiff) == pytest.approx(share(COMPACT))


def test_specified_tyre_values_are_not_scaled():
    given = LARGE.model_copy(update={"front_tyre_stiffness_n_m": 3e5, "front_tyre_damping_n_s_m": 0.0})
    assert (given.front_wheel.stiffness, given.front_wheel.damping) == (3e5, 0.0)


def test_trailer_tyre_stiffness_is_proportional_to_load():
    small, large = (Drawn(mass_kg=kg).hitched(COMPACT).axle.wheel for kg in (500.0, 1000.0))
    assert (small.stiffness, small.damping) == (1.8e5, 1800.0)
    assert (large.stiffness, large.damping) == pytest.approx((3.6e5, 3600.0))
    assert large.load == pytest.approx(1000 * G * 1.75 / 2.0 / 2)


def test_torque_at_relief_pressure_is_three_times_the_parking_torque():
    wide = LARGE.model_copy(update={"front_wheel_width_m": 0.36})
    laid = Linkage(kingpin_offset_m=0.05, friction_n_m=20.0)
    rule = 0.75 * 3600 * G * 0.44 * sqrt(0.36**2 / 8 + 0.05**2)
    assert Cylinder().column(wide, laid).relief_torque == pytest.approx(3 * rule)
    assert Cylinder(relief_pressure_bar=50).column(wide).relief_torque == pytest.approx(50e5 * Cylinder().displacement)


def test_oil_column_stiffness_scales_with_load_and_width_of_front_tyres():
    heavy = COMPACT.model_copy(update={"mass_kg": 1500.0, "front_wheel_width_m": 0.24})
    assert Cylinder().column(COMPACT)[1:] == (5e4, 400.0)
    assert Cylinder().column(heavy)[1:] == pytest.approx((1.5e5, 1200.0))
    assert Cylinder(stiffness_n_m_rad=1e4, damping_n_m_s_rad=7.0).column(heavy)[1:] == (1e4, 7.0)


@pytest.mark.parametrize("implement", [Drawn(mass_kg=900.0), Mounted(mass_kg=150.0), Mounted(linkage="float")])
def test_loads_of_tractor_and_implement_wheels_add_up_to_the_weight(implement):
    hitched = implement.hitched(COMPACT)
    front, rear = wheel_loads(COMPACT, hitched)
    wheel = hitched.depth_wheel
    on_depth_wheel = wheel.stiffness * (-COMPACT.hitch_height_m - wheel.at[2])
    own, wheels = (2 * hitched.axle.wheel.load, 2 * hitched.axle.wheel.mass) if hitched.axle else (on_depth_wheel, 0.0)
    assert own + 2 * (front + rear) == pytest.approx(G * (COMPACT.mass_kg + hitched.mass + wheels))


def test_rear_implement_reduces_the_front_axle_load():
    """The implement has 150 kg, 0.5 m behind a hitch 0.55 m behind the axle, and the wheelbase is 1.4 m."""
    front, _ = wheel_loads(COMPACT, Mounted(mass_kg=150.0, cg_behind_m=0.5).hitched(COMPACT))
    assert front == pytest.approx(COMPACT.front_wheel.load - 150 * G * 1.05 / 1.4 / 2)


def test_mass_and_wheelbase_define_a_tractor_of_the_same_shape():
    """At twice the length and eight times the mass, inertias scale with the fifth power of the length."""
    large = TractorParameters(mass_kg=6000.0, wheelbase_m=2.8)
    inertias = (large.roll_inertia_kg_m2, large.pitch_inertia_kg_m2, large.yaw_inertia_kg_m2)
    assert inertias == pytest.approx((32 * 120, 32 * 340, 32 * 400))
    assert (large.track_m, large.cg_height_m, large.rear_wheel_radius_m) == pytest.approx((2.0, 1.1, 0.84))
    assert (large.front_wheel_mass_kg, large.rear_wheel_mass_kg) == pytest.approx((8 * 18, 8 * 45))
    assert large.antenna_height_m == pytest.approx(2.0 + 2 * (0.84 - 0.42))
    assert large.model_fields_set == {"mass_kg", "wheelbase_m"}


def test_roll_and_pitch_inertia_scale_with_a_specified_yaw_inertia():
    given = TractorParameters(mass_kg=6000.0, wheelbase_m=2.8, yaw_inertia_kg_m2=16000.0)
    assert (given.roll_inertia_kg_m2, given.pitch_inertia_kg_m2) == pytest.approx((40 * 120, 40 * 340))
    assert TractorParameters(roll_inertia_kg_m2=100.0).yaw_inertia_kg_m2 == 400.0


def test_lengths_derived_from_size_stay_within_the_ranges_of_their_keys():
    assert TractorParameters(wheelbase_m=10.0).rear_wheel_radius_m == 2.0
    assert TractorParameters(**TractorParameters(wheelbase_m=0.5).model_dump()).wheelbase_m == 0.5


def test_steering_rate_and_speed_gain_are_independent_of_size():
    large = load_scenario("straight_line", {"tractor.wheelbase_m": 2.8, "tractor.mass_kg": 6000.0})
    small = load_scenario("straight_line")

    def rate(s):
        return s.steering.valve.largest_flow / s.steering.cylinder.displacement

    assert rate(large) == pytest.approx(rate(small))
    fast = small.changed({"driveline.full_speed_m_s": 10.0})
    for gain in ("outer.kp", "outer.ki", "feedforward_s_m"):
        assert 2 * attrgetter(gain)(fast.speed) == pytest.approx(attrgetter(gain)(small.speed))
    kept = fast.changed({"speed.outer": {"kp": 0.3, "ki": 0.2}})
    assert (kept.speed.outer.kp, kept.speed.outer.ki) == (0.3, 0.2)


@pytest.mark.parametrize(
    ("kinds", "key", "ratio"),
    [
        ({"plant.kind": "bicycle"}, "plant.front_cornering_stiffness_n_rad", 8.0),
        ({"plant.tyre.kind": "linear"}, "plant.tyre.rear_slip_stiffness_n", 8.0),
        ({"guidance.kind": "lqr"}, "guidance.rear_cornering_stiffness_n_rad", 8.0),
        ({"guidance.kind": "pure_pursuit"}, "guidance.lookahead_m", 2.0),
        ({"guidance.kind": "stanley"}, "guidance.reverse_heading_gain", sqrt(2.0)),
        ({}, "plant.tyre.trail_m", 2.0),
        ({}, "sensors.gnss.dual_antenna.baseline_m", 2.0),
        ({}, "sensors.imu.up_m", 2.0),
        ({"path.kind": "swaths"}, "path.turn_radius_m", 2.0),
        ({"path.kind": "contour"}, "path.swath_m", 2.0),
        ({"path.kind": "figure_eight"}, "path.wheelbase_m", 2.0),
        ({"path.kind": "waypoints", "path.file": "hills_route.csv"}, "path.corner_radius_m", 2.0),
    ],
)
def test_lengths_and_loads_scale_with_the_machine_unless_specified(kinds, key, ratio):
    small = load_scenario("straight_line", kinds)
    large = small.changed({"tractor.wheelbase_m": 2.8, "tractor.mass_kg": 6000.0})
    assert attrgetter(key)(large) == pytest.approx(ratio * attrgetter(key)(small))
    assert attrgetter(key)(large.changed({key: attrgetter(key)(small)})) == attrgetter(key)(small)


def test_every_key_listed_as_size_dependent_exists():
    for spec in {key.owner for key in keys(Scenario)}:
        for name in spec.sized:
            attrgetter(name)(spec())


def swaths(**given):
    """Return the swaths path of a tractor with the given keys, in which two underscores stand for a dot."""
    keys = {key.replace("__", "."): value for key, value in given.items()}
    return load_scenario("straight_line", {"path.kind": "swaths", **keys}).path


def test_default_headland_turn_radius_scales_with_the_turning_circle():
    """L / tan(30 deg) is sqrt(3) times the value at 45 deg. Above 45 deg, the radius remains constant."""
    assert swaths(tractor__steer_limit_deg=30.0).turn_radius_m == pytest.approx(3.0 * sqrt(3.0))
    assert swaths(tractor__steer_limit_deg=55.0).turn_radius_m == 3.0
    assert swaths(tractor__steer_limit_deg=30.0, path__turn_radius_m=3.2).turn_radius_m == 3.2


def test_swath_width_defaults_to_the_specified_implement_width():
    assert swaths().swath_m == swaths(implement__kind="mounted").swath_m == 2.0
    assert swaths(implement__kind="mounted", implement__width_m=2.6).swath_m == pytest.approx(2.6)
    assert swaths(implement__kind="drawn", implement__width_m=2.6, path__swath_m=2.5).swath_m == 2.5
    assert swaths(tractor__track_m=1.3).swath_m == pytest.approx(2.6)


def test_clothoid_figure_eight_too_tight_for_the_wheelbase_is_rejected():
    tight = {"path.kind": "figure_eight", "path.transition": "clothoid", "path.radius_m": 2.0, "path.speed_m_s": 1.5}
    assert load_scenario("straight_line", tight).path.radius_m == 2.0
    with pytest.raises(ScenarioError, match=r"path\.radius_m: must be at least [0-9.]+ for clothoids at 1\.5"):
        load_scenario("straight_line", tight | {"tractor.wheelbase_m": 2.2, "tractor.mass_kg": 3000.0})
