"""Field plans: courses that the machine can follow and that cover the field, and their files."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from field_shapes import FIELDS, HOLE, L_SHAPE, RECTANGLE, SLANTED, default_plan, machine
from shapely import Polygon, box

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.resources import stamp_of
from agrobot_mj.extensions.fields.coverage import areas
from agrobot_mj.extensions.fields.drive import planning_scenario
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.given_plan import given_plan
from agrobot_mj.extensions.fields.output import plan_text
from agrobot_mj.extensions.fields.plan import MAX_BYTES, plan_of, to_json
from agrobot_mj.extensions.fields.plan_path import FieldPlan
from agrobot_mj.extensions.fields.planned import planned_coverage
from agrobot_mj.extensions.fields.planner import planning
from agrobot_mj.extensions.fields.planner.area import ENTERED_M, SWING_M, TOLERANCE_M, area_of, body_of, whole_of
from agrobot_mj.extensions.fields.planner.joins import _turns, depth_of_turn, join
from agrobot_mj.extensions.fields.planner.leaving import Leaving, leaving
from agrobot_mj.extensions.fields.planner.planning import Options, make_plan
from agrobot_mj.extensions.fields.planner.rig import BAR_M, outline_of, rig_of, tractor_boxes, tractor_poses
from agrobot_mj.extensions.fields.planner.swaths import SwathFrame
from agrobot_mj.extensions.fields.planner.words import end_of
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.track import chain
from agrobot_mj.scenario.loading import load_scenario


def planned(plan, field):
    """Return the areas covered if a plan is followed exactly."""
    return areas(planned_coverage(plan, whole_of(field), body_of(field, plan)))


def driven_poses(rig, course):
    """Return the CG poses of a machine at the joints of a course."""
    return tractor_poses(course.divided(), rig.cg_to_rear_axle)


@pytest.mark.parametrize("field", FIELDS, ids=lambda field: field.name)
def test_planned_work_covers_the_field_except_for_corners(field):
    found = planned(default_plan(field), field)
    assert found["body"]["missed_percent"] < 0.05
    assert found["field"]["missed_percent"] < 3.0


@pytest.mark.parametrize("turn", ["omega", "bulb", "clothoid", "k"])
def test_plan_respects_the_curvature_limit_of_the_machine(turn):
    rig = machine(turn=turn)
    course = make_plan(L_SHAPE, rig, Options(turn=turn)).course
    assert course.peaks.max() <= rig.max_curvature
    if turn != "omega":
        bends = np.abs(course.sharpnesses)[course.lengths > 0]
        assert bends.max() <= 1.001 * max(rig.bends.sharpness, rig.path.sharpness(0.3))


def test_each_turn_kind_has_a_distinct_shape_on_a_deep_enough_headland():
    lengths, cusps = {}, {}
    for turn in ("omega", "bulb", "clothoid", "k"):
        rig = machine(turn=turn)
        area = area_of(RECTANGLE, 4, rig)
        pieces = join(area, Pose(48.0, 20.0, 0.0), Pose(48.0, 23.0, np.pi), turn).pieces
        end = end_of(Pose(48.0, 20.0, 0.0), pieces)
        assert (end.x, end.y, wrap(end.yaw - np.pi)) == pytest.approx((48.0, 23.0, 0.0), abs=1e-5)
        lengths[turn] = sum(piece.length for piece in pieces)
        cusps[turn] = sum(piece.direction < 0 for piece in pieces)
    assert cusps == {"omega": 0, "bulb": 0, "clothoid": 0, "k": cusps["k"]}
    assert cusps["k"] > 0
    assert len({round(length, 2) for length in lengths.values()}) == 4


@pytest.mark.parametrize("turn", ["omega", "k"])
def test_rear_axle_rolls_without_sideslip_along_the_poses_of_a_plan(turn):
    length = 1.2
    course = make_plan(L_SHAPE, machine(turn=turn), Options(turn=turn)).course.divided()
    x, y, yaw = tractor_poses(course, length)
    moved = np.diff(x - length * np.cos(yaw)) + 1j * np.diff(y - length * np.sin(yaw))
    aside = (moved * np.exp(-0.5j * (yaw[:-1] + yaw[1:]))).imag
    reversal = np.diff(course.directions, prepend=1.0) < 0
    assert reversal.any()
    assert np.abs(aside[~reversal]).max() < 0.01 * course.lengths.max()


@pytest.mark.parametrize("turn", ["omega", "bulb", "clothoid", "k"])
def test_turn_just_fits_into_a_headland_of_its_required_depth(turn):
    rig = machine(turn=turn)
    depth = depth_of_turn(rig, turn)
    field = Field("strip", Polygon([(0, 0), (80, 0), (80, 60), (0, 60)]))
    poses = partial(driven_poses, rig)
    area, end = area_of(field, 0, rig), 80.0 - depth + rig.behind
    start, goal = Pose(end, 30.0, 0.0), Pose(end, 33.0, np.pi)
    pieces = next(_turns(start, goal, turn, rig.bends))
    outside = area.outside(*poses(chain(start, pieces))).max()
    beyond = area.outside(*poses(chain(start._replace(x=end + 0.2), pieces))).max()
    assert (outside, beyond) == pytest.approx((0.0, 0.2), abs=1e-6)


def test_connection_to_a_distant_swath_follows_a_headland_lap():
    area = area_of(RECTANGLE, 3, machine())
    start, goal = Pose(50.0, 12.0, 0.0), Pose(10.0, 28.0, 0.0)
    found = join(area, start, goal, "clothoid")
    assert found.free
    assert sum(piece.length for piece in found.pieces) > 60.0


def test_planned_passes_are_numbered_in_driving_order():
    plan = default_plan(RECTANGLE)
    assert [one.part for one in plan.passes] == ["headland"] * 3 + ["body"] * 8
    ends = np.array([(one.start, one.end) for one in plan.passes]).ravel()
    assert np.all(np.diff(ends) > -1e-9)
    assert plan.angle_deg == 0.0


def test_skipping_passes_needs_no_more_reversals_than_driving_in_order():
    near, far = default_plan(RECTANGLE), make_plan(RECTANGLE, machine(), Options(headlands=3, order="skip"))
    assert len(near.passes) == len(far.passes)
    assert sum(p.direction < 0 for p in far.pieces) <= sum(p.direction < 0 for p in near.pieces)


def test_plan_uses_the_specified_swath_angle():
    assert make_plan(SLANTED, machine(), Options(frame=SwathFrame(np.pi / 2))).angle_deg == 90.0


def test_section_control_reduces_overlap_at_oblique_field_edges():
    rig = machine()
    one, six = (planned(make_plan(SLANTED, rig, Options(frame=SwathFrame(0.0), sections=n)), SLANTED) for n in (1, 6))
    assert six["field"]["overlapped_m2"] < one["field"]["overlapped_m2"] - 5.0
    assert six["body"]["missed_m2"] < one["body"]["missed_m2"] + 0.1


@pytest.mark.parametrize(("field", "width"), [*((field, 3.0) for field in FIELDS), (SLANTED, 1.8), (L_SHAPE, 6.0)])
def test_machine_stays_inside_the_field_with_default_headlands(field, width):
    rig, plan = machine(width), default_plan(field, width)
    tractor, implement, middle = area_of(field, 0, rig).outside(*driven_poses(rig, plan.course)).max(axis=1)
    assert tractor <= TOLERANCE_M
    assert implement <= SWING_M + TOLERANCE_M
    assert middle == 0.0
    assert (plan.headlands > 2) == any("headland laps instead of 2" in warning for warning in plan.warnings)


@pytest.mark.parametrize("headlands", [0, pytest.param(1, marks=pytest.mark.slow), 2])
def test_error_for_too_shallow_a_headland_gives_the_required_depth(headlands):
    with pytest.raises(ScenarioError, match=f"--headlands {headlands}: .*use at least 3 laps \\(9 m\\)"):
        make_plan(RECTANGLE, machine(), Options(headlands=headlands))


def test_margin_replaces_headland_laps_that_do_not_fit(monkeypatch):
    excess = {(2, 0.0): 1.5, (3, 0.0): 0.4, (3, 0.42): 0.0}

    def work(field, rig, options, laps, margin):
        if (laps, margin) not in excess:
            raise ScenarioError("too narrow")
        return SimpleNamespace(leaving=SimpleNamespace(laps=0.0, turns=excess[laps, margin]))

    monkeypatch.setattr(planning, "_work", work)
    found = planning._attempts(RECTANGLE, machine(), Options(), 2, 2)
    assert [(each.laps, each.margin) for each in found] == list(excess)


def test_permitted_excursion_beyond_the_boundary_gives_a_warning():
    plan = make_plan(RECTANGLE, machine(), Options(headlands=1, beyond=4.0))
    assert plan.headlands == 1
    assert any("leaves the field by up to 3" in warning for warning in plan.warnings)


def test_headland_laps_of_a_long_implement_keep_a_boundary_margin():
    rig = replace(machine(4.0), behind=3.0)
    plan = make_plan(RECTANGLE, rig, Options())
    assert 0.05 < plan.margin < 0.5
    assert any(f"keeps {plan.margin:.2f} m from the boundary" in warning for warning in plan.warnings)
    area = area_of(RECTANGLE, 0, rig)
    assert area.excess(area.outside(*driven_poses(rig, plan.course))).max() == 0.0


def test_plan_with_headlands_around_a_hole_stays_inside_the_field():
    plan = make_plan(HOLE, machine(width=4.0), Options(headlands=3))
    assert not any("leaves the field by up to 1" in warning for warning in plan.warnings)


@pytest.mark.parametrize("obstacle", [box(-0.3, -0.3, 0.3, 0.3), box(-0.1, -30.0, 0.1, 30.0)])
def test_obstacle_between_the_tractor_corners_counts_as_leaving_the_field(obstacle):
    rig, field = machine(), Field("pole", box(-40, -30, 40, 31).difference(obstacle))
    outside = area_of(field, 0, rig).outside(np.array([0.0, 15.0]), np.zeros(2), np.zeros(2))
    assert outside[:, 0] == pytest.approx([ENTERED_M, 0.0, 0.0])
    assert outside[:, 1] == pytest.approx([0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("half", "north", "outside"), [(1.0, 0.0, (0.9, 0.2)), (0.2, 0.0, (0.1, 0.2)), (0.2, 1.4, (0.1, 0.0))]
)
def test_only_obstacles_below_implement_ends_are_swung_over(half, north, outside):
    """The implement is 3 m wide. Obstacles between its ends count as 0.2 m."""
    rig = machine()
    field = Field("pole", box(-40, -30, 40, 30).difference(box(-half, north - half, half, north + half)))
    area = area_of(field, 0, rig)
    found = area.outside(np.array([rig.behind]), np.zeros(1), np.zeros(1))
    assert found[1:, 0] == pytest.approx(outside)
    assert (area.excess(found) > 0.0) == (outside[1] > 0.0)


@pytest.mark.parametrize("beyond", [0.0, 1.0])
def test_implement_beyond_the_boundary_has_its_true_distance(beyond):
    """Only the ends of the implement may swing beyond the boundary by 0.3 m, the whole implement by `beyond`."""
    rig, field = machine(), Field("rectangle", box(-40, -30, 40, 30))
    area = area_of(field, 0, rig, beyond)
    found = area.outside(np.array([-40.0 + rig.behind + BAR_M - 0.12]), np.zeros(1), np.zeros(1))
    assert found[:2, 0] == pytest.approx([0.02, 0.12], abs=0.021)
    assert (area.excess(found) > 0.0) == (beyond == 0.0)


def test_connections_of_a_plan_do_not_cross_a_narrow_obstacle():
    rig, pole = machine(), box(45.0, 40.0, 45.6, 40.6)
    plan = make_plan(Field("pole", box(0, 0, 90, 80).difference(pole)), rig, Options())
    outlines = tractor_boxes(rig, *driven_poses(rig, plan.course))
    assert not shapely.intersects(outlines, pole).any()


def test_headland_lap_too_narrow_for_the_turn_radius_is_rejected():
    with pytest.raises(ScenarioError, match="--headlands 3: lap 3"):
        make_plan(RECTANGLE, machine(width=7.4), Options(headlands=3))


@pytest.mark.parametrize(
    ("notch", "unfilled_m2", "missed_m2"), [(box(74.5, 0, 75.5, 60), 2100, 1000), (box(38, 0, 42, 60), 1200, 650)]
)
def test_parts_of_the_headland_that_laps_omit_get_swaths(notch, unfilled_m2, missed_m2, monkeypatch):
    """Beside a notch, laps may have no space for a bend."""
    field = Field("notch", box(0, 0, 150, 100).difference(notch))
    base = planning_scenario("field", {"transition": "clothoid", "speed_m_s": 2.0}, {"machine": "row_crop"})
    rig = rig_of(base, 6.0)
    plan = make_plan(field, rig, Options())
    assert planned(plan, field)["field"]["missed_m2"] < missed_m2
    assert leaving(area_of(field, plan.headlands, rig), plan.start, plan.pieces, plan.passes).turns == 0.0
    monkeypatch.setattr(planning, "_with_headland_swaths", lambda work: work)
    assert planned(make_plan(field, rig, Options()), field)["field"]["missed_m2"] > unfilled_m2


def test_short_headland_lap_around_a_narrow_part_is_omitted_with_a_warning():
    neck = Polygon(
        [
            (0, 0),
            (60, 0),
            (60, 16),
            (80, 16),
            (80, 6),
            (96, 6),
            (96, 26),
            (80, 26),
            (80, 24),
            (60, 24),
            (60, 40),
            (0, 40),
        ]
    )
    plan = make_plan(Field("neck", neck), machine(), Options(headlands=3, beyond=3.0))
    assert any("lap 3 near" in warning and "omits this lap" in warning for warning in plan.warnings)
    assert planned(plan, Field("neck", neck))["body"]["missed_percent"] < 0.05


def test_forward_only_plan_has_no_reverse_segments():
    reversing = default_plan(HOLE)
    assert (reversing.course.directions < 0).any()
    rig = replace(machine(), forward_only=True)
    assert (make_plan(HOLE, rig, Options()).course.directions > 0).all()
    with pytest.raises(ScenarioError, match="--turn k: has a reverse segment, which --no-reverse"):
        make_plan(HOLE, rig, Options(turn="k"))
    with pytest.raises(ScenarioError, match=r"--plan old\.json: has reverse segments, which --no-reverse"):
        given_plan(Path("old.json"), reversing, HOLE, rig, 1)


def test_forward_only_plan_has_space_for_turns_between_adjacent_swaths():
    rig = replace(machine(), forward_only=True)
    field = Field("large", Polygon([(0, 0), (120, 0), (120, 90), (0, 90)]))
    plan = make_plan(field, rig, Options())
    assert plan.headlands * 3.0 >= depth_of_turn(rig, "clothoid") > 2 * 3.0
    assert plan.working_length > 0.75 * plan.length
    assert make_plan(RECTANGLE, rig, Options(headlands=3)).headlands == 3


def test_plan_summary_counts_each_section_and_names_the_largest_gap():
    rig = machine()
    text, numbers = plan_text(make_plan(RECTANGLE, rig, Options(sections=6)), RECTANGLE, 9.0)
    whole = plan_text(make_plan(RECTANGLE, rig, Options()), RECTANGLE, 9.0)[1]
    assert 0.0 < numbers["overlapped_percent"] < whole["overlapped_percent"] < 5.0
    assert "gap" not in text
    assert "to work more" not in text
    plan = make_plan(RECTANGLE, rig, Options())
    text, numbers = plan_text(replace(plan, passes=plan.passes[:2]), RECTANGLE, 9.0)
    assert "; the largest gap is " in text
    assert numbers["missed_percent"] > 10.0
    assert "to work more of the field" in text


def test_machine_with_a_drawn_implement_plans_forward_only():
    keys = {"implement": {"kind": "drawn"}}
    assert outline_of(load_scenario("straight_line", keys), 3.0).forward_only
    assert not outline_of(load_scenario("straight_line", {}), 3.0).forward_only


def test_turn_radius_below_the_minimum_of_the_machine_is_rejected():
    with pytest.raises(ScenarioError, match="--radius 1: the machine compact has a minimum radius of"):
        machine(turn_radius_m=1.0)


def test_plan_is_unchanged_by_writing_and_reading_its_file(tmp_path):
    plan = default_plan(RECTANGLE)
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(to_json(plan)))
    assert plan_of(stamp_of(str(file), (), MAX_BYTES)) == plan
    path = FieldPlan(file=str(file), speed_m_s=2.0)
    path.check()
    assert path.motion.distances[-1] == pytest.approx(plan.length)
    assert path.max_curvature == pytest.approx(plan.course.peaks.max())


@pytest.mark.parametrize(
    ("text", "reason"),
    [("{}", "format"), ("[1", "Expecting"), ('{"format": "agrobot_mj plan 1"}', "has no 'pieces'"), ("\x00", "")],
)
def test_error_for_a_damaged_plan_file_names_the_file(tmp_path, text, reason):
    file = tmp_path / "plan.json"
    file.write_text(text)
    with pytest.raises(ValueError, match=r"file: plan.json: .*" + reason):
        FieldPlan(file=str(file)).check()


def test_planned_overlap_reduces_the_spacing_of_the_passes():
    rig = replace(machine(), overlap=0.2)
    plan = make_plan(RECTANGLE, rig, Options(headlands=3))
    found, exact = planned(plan, RECTANGLE), planned(default_plan(RECTANGLE), RECTANGLE)
    assert plan.overlap == 0.2
    assert 4.0 < found["body"]["overlapped_percent"] - exact["body"]["overlapped_percent"] < 20.0
    assert found["field"]["missed_percent"] < exact["field"]["missed_percent"] + 0.05


def test_boundary_warning_lists_each_location_once():
    zigzag = np.tile([0.0, 0.2], 8)
    x = np.repeat(10.0 * np.arange(8), 2)
    x[2:4] = 0.3  # the second peak is at the location of the first
    place = Leaving(x, 0.0 * x, np.stack([0.0 * zigzag, zigzag]), -np.ones(16), np.zeros(16, dtype=bool))
    (warning,) = place.warnings()
    assert warning.endswith("by up to 0.20 m at (0, 0), (20, 0), (30, 0), (40, 0), (50, 0) m and 2 more")


@pytest.mark.parametrize("seed", [33, 69, 122])
def test_omitted_headland_is_found_in_irregular_fields(seed):
    """GEOS cannot intersect the areas of these fields exactly."""
    rng = np.random.default_rng(seed)
    angle, distance = np.sort(rng.uniform(0, 2 * np.pi, 12)), rng.uniform(40, 90, 12)
    field = Field("irregular", Polygon(np.column_stack([distance * np.cos(angle) * 1.3, distance * np.sin(angle)])))
    scenario = planning_scenario("irregular", {"transition": "clothoid", "speed_m_s": 2.0}, {"machine": "orchard"})
    area = area_of(field, 4, rig_of(scenario, 2.5))
    assert area.omitted.difference(area.worked.buffer(1e-3)).area < 1e-3
    assert area.omitted.intersection(area.body).area < 1e-1
