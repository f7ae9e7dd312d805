"""Hints on the path: tight or abrupt turns with feasible values, and a path that leaves the ground."""

import re
from math import hypot, inf, radians, tan

import numpy as np
import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.scenario.hints import LEAVES_M, Change, hints
from agrobot_mj.scenario.loading import load_scenario

FIELD = {"path.kind": "swaths", "path.length_m": 45.0, "path.swath_m": 4.0, "path.count": 3}


def on_path(**changes):
    """Return the hints on the path of a field, for path keys without their table."""
    given = {f"path.{key}": value for key, value in changes.items() if key != "machine"}
    return hints(load_scenario("straight_line", {**FIELD, **given, "machine": changes.get("machine", "compact")}))


def applied(line):
    """Return the changes suggested by a hint, as path keys."""
    found = re.findall(r"path\.(\w+) (?:=|of) ([\d.]+|\"\w+\")", line.rpartition("; set ")[2])
    return {key: value.strip('"') if '"' in value else float(value) for key, value in found}


def test_swath_width_and_turns_derived_from_the_machine_give_no_hint():
    for machine in ("compact", "riding", "orchard", "robot", "utility", "row_crop"):
        assert on_path(machine=machine) == []


@pytest.mark.parametrize(("machine", "radius", "speed"), [("row_crop", 3.9, 1.0), ("utility", 3.1, 0.9)])
def test_every_value_suggested_for_an_abrupt_turn_removes_the_hint(machine, radius, speed):
    (line,) = on_path(machine=machine, turn_radius_m=radius, turn_speed_m_s=speed)
    assert line.startswith("path.turn_radius_m: at (")
    fixes = applied(line)
    assert set(fixes) == {"turn_radius_m", "turn_speed_m_s", "transition"}
    for key, value in fixes.items():
        given = {"turn_radius_m": radius, "turn_speed_m_s": speed} | {key: value}
        assert on_path(machine=machine, **given) == []


def test_turn_near_the_steering_limit_gives_a_hint_with_feasible_radius():
    """At a radius of 1.9 m, the compact tractor needs 37.5 of 40 deg: sin(beta) = 0.532 / 1.9 at the CG."""
    given = {**FIELD, "path.turn_radius_m": 1.9, "path.transition": "clothoid", "tractor.steer_limit_deg": 40.0}
    (line,) = hints(load_scenario("straight_line", given))
    assert "needs 37.5 deg of steering, the limit of 40" in line
    assert hints(load_scenario("straight_line", given | {"path.turn_radius_m": applied(line)["turn_radius_m"]})) == []


def test_turn_too_fast_for_the_steering_rate_gives_a_hint():
    fast = {"speed_m_s": 2.2, "turn_speed_m_s": 1.8, "lateral_acceleration_m_s2": 1.5}
    (line,) = on_path(**fast)
    assert on_path(**fast, turn_radius_m=applied(line)["turn_radius_m"]) == []


def test_hint_names_the_key_that_limits_the_speed():
    slow = {"speed_m_s": 1.7, "turn_speed_m_s": 5.0, "lateral_acceleration_m_s2": 5.0}
    (line,) = on_path(**slow)
    assert on_path(**slow | {"speed_m_s": applied(line)["speed_m_s"]}) == []


def test_clothoids_too_fast_for_the_valve_give_a_hint():
    fast = {"speed_m_s": 2.2, "turn_speed_m_s": 2.1, "lateral_acceleration_m_s2": 3.0}
    fast |= {"machine": "row_crop", "transition": "clothoid", "turn_radius_m": 4.5}
    assert on_path(**fast) == []
    (line,) = on_path(**fast, steer_rate_deg_s=85.0)
    assert "longer than the path allows" in line
    assert set(applied(line)) == {"turn_radius_m", "turn_speed_m_s"}


def test_predicted_offset_after_a_curvature_step_equals_the_integral():
    """Heading and offset are integrals of a curvature that increases linearly over a distance centred at the step."""
    tractor, rate = TractorParameters(), radians(20.0)
    step = Change(0.0, 0.08, 0.0, 3.0, (0.0, 0.0))
    way = 3.0 * tractor.steering_for(0.08) / rate
    s = np.linspace(-way / 2, way / 2, 20001)
    error = 0.08 * ((s + way / 2) / way - (s > 0))
    offset = np.trapezoid(np.cumsum(error) * (s[1] - s[0]), s)
    assert step.leaves(tractor, rate) == pytest.approx(offset, rel=1e-3)
    assert step._replace(takes=1.0).leaves(tractor, rate) < step.leaves(tractor, rate)
    assert step._replace(takes=inf).leaves(tractor, rate) == 0.0


@pytest.mark.parametrize("machine", [TractorParameters(), TractorParameters(wheelbase_m=2.6, front_load_fraction=0.45)])
def test_circle_of_minimum_radius_requires_the_full_steering_angle(machine):
    """The rear axle moves on a radius L / tan(limit), and the CG is l_r ahead of the rear axle."""
    rear = machine.wheelbase_m / tan(machine.steer_limit)
    assert machine.tightest_radius == pytest.approx(hypot(rear, machine.cg_to_rear_axle))
    assert machine.steering_for(1 / machine.tightest_radius) == pytest.approx(machine.steer_limit)
    assert machine.steering_for(-0.1) == -machine.steering_for(0.1)
    assert machine.steering_for(99.0) == pytest.approx(radians(90.0))


def test_error_for_a_circle_below_the_minimum_radius_states_this_radius():
    """L / tan(45 deg) = 1.4 m at the rear axle and l_r = 0.532 m give 1.498 m at the CG."""
    given = {"path.kind": "circle", "path.speed_m_s": 0.4}
    with pytest.raises(ScenarioError, match=r"the limit is 45 deg \(radius 1\.50 m\); use a larger radius"):
        load_scenario("straight_line", given | {"path.radius_m": 1.49})
    assert load_scenario("straight_line", given | {"path.radius_m": 1.51}).path.radius_m == 1.51


def test_path_leaving_the_terrain_gives_a_hint_with_position_and_time():
    given = {"path.length_m": 90.0, "terrain.half_size_m": 70.0, "path.heading_deg": 90.0, "duration_s": 80.0}
    (line,) = hints(load_scenario("straight_line", given))
    place = re.fullmatch(
        r"path: the path leaves the terrain at \(0, (\d+)\) m after (\d+) s; .* \(-70, -70\) to \(70, 70\) m; .*",
        line,
    )
    north, seconds = (float(text) for text in place.groups())
    assert north == pytest.approx(70.0, abs=1.0)
    assert seconds == pytest.approx(70.0 / 1.2 + 2.0, abs=1.0)


def test_path_ending_at_the_edge_of_the_terrain_gives_a_hint():
    """A tractor that is ahead of its reference leaves the ground before the run ends."""
    given = {"path.length_m": 70.0, "terrain.half_size_m": 70.0, "duration_s": None}
    assert "leaves the terrain" in hints(load_scenario("straight_line", given))[0]


def test_run_that_ends_before_its_path_leaves_the_terrain_has_no_hint():
    given = {"path.length_m": 90.0, "terrain.half_size_m": 70.0}
    assert hints(load_scenario("straight_line", given | {"duration_s": 50.0})) == []
    assert hints(load_scenario("off_the_field")) == []


@pytest.mark.parametrize(("east", "fix"), [(540.0, "make the terrain larger"), (31_500.0, "shift the path: subtract")])
def test_error_for_a_start_outside_the_terrain_states_size_and_remedy(east, fix):
    with pytest.raises(ScenarioError, match=rf"outside the terrain, which extends 500 m from its centre.*; {fix}"):
        load_scenario("straight_line", {"path.start_x_m": east})


def test_offset_at_turns_of_the_shipped_field_is_below_the_hint_limit():
    """The compact tractor leaves the path by at least 0.1 m in the omega turns of the library's field."""
    s = load_scenario("one_hectare")
    turn = Change(1 / 3, -1 / 3, 0.0, 1.0, (0.0, 0.0))
    assert 0.05 < turn.leaves(s.tractor, s.vehicle.steering_rate) < LEAVES_M
