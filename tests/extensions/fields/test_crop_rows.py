"""Crop rows under the wheels, compared with closed forms for a plan followed with a constant lateral offset."""

from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from field_shapes import default_plan, machine

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.fields.crop_rows import CropRows, crop_rows, lines_of, run_over, wheel_tracks
from agrobot_mj.extensions.fields.field import Field
from agrobot_mj.extensions.fields.planner.area import body_of
from agrobot_mj.machine.tractor import TractorParameters

TRACTOR = TractorParameters()
"""Compact tractor: track width 1.0 m, rear tyres of 0.24 m, and narrower front tyres."""
FIELD = Field("oblong", shapely.box(0, 0, 50, 39))
PLAN = default_plan(FIELD)
BODY = body_of(FIELD, PLAN)
SWATHS = sum(one.part == "body" for one in PLAN.passes)


def followed(offset):
    """Return the log of a run along the plan with a lateral offset, left positive [m]."""
    course = PLAN.course.divided()
    x, y, yaw = course.joints()
    found = {"t": course.distances(), "x": x - offset * np.sin(yaw), "y": y + offset * np.cos(yaw), "yaw": yaw}
    return SimpleNamespace(scenario=SimpleNamespace(tractor=TRACTOR), column={**found, "steer": 0 * x}.__getitem__)


def found(offset, angle=None, spacing=0.75):
    """Return the crop rows run over at a lateral offset [m]. The rows are rotated from the swaths by `angle` [deg]."""
    rows = CropRows(spacing, PLAN.angle_deg + (angle or 0.0))
    return run_over(rows, PLAN, BODY, machine(), followed(offset))


def test_swath_edges_lie_midway_between_two_crop_rows():
    lines = lines_of(CropRows(0.75, PLAN.angle_deg), PLAN, BODY)
    assert shapely.length(lines).sum() == pytest.approx(BODY.area / 0.75, rel=0.03)
    west, south, *_ = BODY.bounds
    across = np.sort([np.ptp(shapely.get_coordinates(line), axis=0).argmin() for line in lines])
    assert set(across) == {across[0]}
    first = shapely.get_coordinates(lines[0])[0, across[0]] - (west, south)[across[0]]
    assert first == pytest.approx(0.375, abs=1e-6)


def test_wheel_tracks_of_a_straight_pass_are_two_strips():
    x = np.linspace(0.0, 100.0, 1001)
    tracks = wheel_tracks(TRACTOR, x, x, 0 * x, 0 * x, 0 * x)
    assert shapely.union_all(tracks).area == pytest.approx(2 * (100.0 * 0.24 + TRACTOR.wheelbase_m * 0.16), rel=1e-6)


@pytest.mark.parametrize("angle", [None, 90.0])
def test_exactly_followed_plan_runs_over_no_crop_rows(angle):
    assert found(0.0, angle)["run_over_m"] < 1e-3 * found(0.0, angle)["rows_m"]


def test_lateral_offset_of_20_cm_runs_over_one_crop_row_per_swath():
    """Wheels 0.5 m from the centre line and displaced by 0.2 m reach one of the two rows at 0.375 m."""
    rows = len(lines_of(CropRows(0.75, PLAN.angle_deg), PLAN, BODY))
    for offset in (0.2, -0.2):
        assert found(offset)["run_over_percent"] == pytest.approx(100 * SWATHS / rows, rel=0.002)


@pytest.mark.parametrize(("offset", "wide"), [(0.1, 0.1), (0.2, 0.2), (0.3, 0.24)])
def test_displaced_wheels_run_over_crop_rows_across_the_swaths(offset, wide):
    fraction = SWATHS * 2 * wide / np.ptp(shapely.get_coordinates(BODY), axis=0).min()
    assert found(offset, 90.0)["run_over_percent"] == pytest.approx(100 * fraction, rel=0.002)


def test_crop_rows_without_a_known_direction_or_spacing_are_rejected():
    unknown = SimpleNamespace(angle_deg=None)
    assert crop_rows(PLAN, None, None) is None
    assert crop_rows(unknown, 0.5, 30.0) == CropRows(0.5, 30.0)
    with pytest.raises(ScenarioError, match=r"--row-spacing 0\.5: the plan has no swath direction; set --row-angle"):
        crop_rows(unknown, 0.5, None)
    with pytest.raises(ScenarioError, match="--row-angle 30: the row spacing is missing; set --row-spacing"):
        crop_rows(PLAN, None, 30.0)
