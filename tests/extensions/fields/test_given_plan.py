"""Plans of other programs: conversion of polylines to courses of the machine."""

import json
from dataclasses import replace

import numpy as np
import pytest
from field_shapes import RECTANGLE, default_plan, machine

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.fields.field import Leg
from agrobot_mj.extensions.fields.given_plan import given_plan, plan_of_legs, stored_plan
from agrobot_mj.extensions.fields.plan import to_json

EAST = Leg(np.array([[10.0, 10.0], [40.0, 10.0]]))
WEST = Leg(np.array([[40.0, 13.0], [10.0, 13.0]]))
ROUND = Leg(np.array([[10.0, 13.0], [3.0, 13.0], [3.0, 22.0]]), 1.0, working=False)
BACK = Leg(np.array([[3.0, 22.0], [3.0, 12.0]]), working=False, reverse=True)


def test_separate_plan_legs_are_joined_within_the_curvature_limit():
    rig = machine()
    plan = plan_of_legs("field", (EAST, WEST), rig, 2)
    assert [one.end - one.start for one in plan.passes] == pytest.approx([30.0, 30.0])
    assert all(len(one.sections) == 2 for one in plan.passes)
    assert plan.course.peaks.max() <= rig.max_curvature
    x, y, _ = plan.course.joints()
    assert (x[-1], y[-1]) == pytest.approx((10.0 - rig.behind, 13.0), abs=1e-4)


def test_adjoining_plan_legs_are_joined_without_a_connecting_path():
    plan = plan_of_legs("field", (WEST, ROUND), machine(), 1)
    assert plan.length < 30.0 + 16.0
    assert min(piece.speed for piece in plan.pieces) == 1.0


def test_points_of_a_reverse_leg_are_unchanged():
    plan = plan_of_legs("field", (ROUND, BACK), machine(), 1)
    x, y, yaw = plan.course.joints()
    assert plan.course.directions[-1] == -1.0
    assert (x[-1], y[-1]) == pytest.approx((3.0, 12.0), abs=1e-6)
    assert np.sin(yaw[-1]) == pytest.approx(1.0)
    assert plan.passes == ()


def test_error_for_a_bend_too_tight_for_the_machine_names_the_plan_leg():
    sharp = Leg(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]))
    with pytest.raises(
        ValueError,
        match=r"leg 2: the bend radius of .* is below the minimum turn radius of the "
        r"machine",
    ):
        plan_of_legs("field", (EAST, sharp), machine(), 1)


def test_plan_of_a_machine_with_a_smaller_turn_radius_is_rejected(tmp_path):
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(to_json(default_plan(RECTANGLE))))
    slow = replace(machine(), tightest=9.0)
    with pytest.raises(
        ScenarioError, match=r"--plan plan.json: the bend of radius .* is below the minimum turn radius of the machine"
    ):
        given_plan(file, stored_plan(file), RECTANGLE, slow, 1)


def test_plan_of_another_working_width_is_rejected(tmp_path):
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(to_json(default_plan(RECTANGLE))))
    with pytest.raises(ScenarioError, match=r"--width 4: the plan plan.json is for a width of 3 m; omit --width"):
        given_plan(file, stored_plan(file), RECTANGLE, machine(4.0), 1)


def test_plan_of_another_number_of_sections_is_rejected(tmp_path):
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(to_json(plan_of_legs("field", (EAST, WEST), machine(), 3))))
    stored = stored_plan(file)
    assert given_plan(file, stored, RECTANGLE, machine(), stored.sections).passes == stored.passes
    with pytest.raises(ScenarioError, match=r"--sections 1: the plan plan.json is for 3 sections; omit --sections, or"):
        given_plan(file, stored, RECTANGLE, machine(), 1)


def test_error_for_plan_lines_names_the_stored_plan_next_to_them(tmp_path):
    back = {"type": "LineString", "coordinates": [[0, 10], [30, 10], [30, 10], [5, 10.1]]}
    name = {"type": "name", "properties": {"name": "local plane in metres"}}
    feature = {"type": "Feature", "properties": {"kind": "turn"}, "geometry": back}
    drawn = tmp_path / "plan.geojson"
    drawn.write_text(json.dumps({"type": "FeatureCollection", "crs": name, "features": [feature]}))
    with pytest.raises(ScenarioError, match=r"turns back by 180 deg .* add a waypoint next to it$"):
        given_plan(drawn, None, RECTANGLE, machine(), 1)
    (tmp_path / "field_plan.json").write_text("{}")
    with pytest.raises(ScenarioError, match=r", or specify field_plan.json in the same folder$"):
        given_plan(drawn, None, RECTANGLE, machine(), 1)


def test_repairs_of_a_plan_file_are_reported_as_warnings(tmp_path):
    (tmp_path / "plan.csv").write_text("x,y,speed\n10,10,2\n,,\n,,2\n30,10,\n40,10,2\n")
    warnings = given_plan(tmp_path / "plan.csv", None, RECTANGLE, machine(), 1).warnings
    assert warnings == ("1 row without a position is omitted", "missing speeds in 1 rows are interpolated")


def test_plan_without_legs_is_rejected():
    with pytest.raises(ValueError, match="the plan has no passes"):
        plan_of_legs("field", (), machine(), 1)
