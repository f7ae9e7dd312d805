"""Recordings of field work: map of passes on slopes, and sections of the implement."""

import json

import numpy as np
import pytest
from recorded import Recorded

from agrobot_mj.core.palette import GREEN, GREY, rgba
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.terrain.grid import heights

pytest.importorskip("shapely")


@pytest.fixture
def recorded(tmp_path, call):
    """Return a function that simulates work on a field of 0.1 ha and returns the recording."""

    def simulate(*options):
        (tmp_path / "field.csv").write_text("x,y\n0,0\n40,0\n40,25\n0,25\n", encoding="utf-8")
        command = ("field", "run", tmp_path / "field.csv", "--quiet", "--out", tmp_path / "out", *options)
        assert call(*map(str, command))[0] == 0
        return Recorded(tmp_path / "out" / "run.rrd")

    return simulate


def test_map_of_passes_lies_on_the_slope(recorded):
    slope = {"terrain.kind": "slope", "terrain.grade_deg": 6}
    sets = [word for key, value in {**slope, "duration_s": 30}.items() for word in ("--set", f"{key}={value}")]
    found = recorded(*sets)
    points = np.array(found.static("/world/areas/passes", "Mesh3D:vertex_positions"))
    x, y, z = points.T
    assert np.ptp(z) > 1.0
    assert z == pytest.approx(heights(load_scenario("straight_line", slope).terrain.ground(), x, y) + 0.01, abs=1e-5)
    image = found.static("/world/areas/passes", "Mesh3D:albedo_texture_format")
    assert image[0]["width"] * 0.25 == pytest.approx(np.ptp(x), abs=1e-4)


def test_sections_are_grey_for_the_duration_of_each_turn(recorded, tmp_path):
    found = recorded("--sections", "2", "--set", "plant.kind=bicycle")
    entity = "/world/bodies/chassis/sections"
    times, colours = found.column(entity, "Boxes3D:colors")
    ahead, left, _ = np.array(found.static(entity, "Boxes3D:centers")).T
    assert left == pytest.approx([0.75, -0.75], abs=1e-3)
    assert (ahead < -0.5).all()  # behind the rear axle
    assert times[0] == 0
    on = np.array(colours) == rgba(GREEN)
    assert (on | (np.array(colours) == rgba(GREY))).all()
    changes = np.diff(on.any(axis=1).astype(int))
    starts, ends = times[1:][changes == 1], times[1:][changes == -1]
    pauses = 1e-9 * (starts[1:] - ends[: len(starts) - 1])
    turns = json.loads((tmp_path / "out" / "coverage.json").read_text(encoding="utf-8"))["each_turn"]
    assert len(turns) == 4
    assert pauses[-4:] == pytest.approx([turn["time_s"] for turn in turns], abs=2 * TICK_S)
