"""Display of ruts at their positions, added in blocks as the tractor advances."""

import numpy as np
import pytest
from recorded import Recorded

from agrobot_mj import load_scenario, run
from agrobot_mj.recording import Recording


@pytest.fixture(scope="module")
def rutted(tmp_path_factory):
    path = tmp_path_factory.mktemp("rutted") / "run.rrd"
    scenario = load_scenario("straight_line", {"duration_s": 12.0, "plant.tyre": {"kind": "ruts"}})
    return Recorded(path, run(scenario, (Recording(path),)))


def test_rut_segment_appears_when_the_first_wheel_arrives(rutted):
    pieces = sorted(name for name in rutted.entities() if name.startswith("/world/ruts/"))
    assert pieces == [f"/world/ruts/{k}" for k in range(3)]
    t, x = rutted.log.column("t"), rutted.log.column("x")
    for k, name in enumerate(pieces):
        times, (points,) = rutted.column(name, "Mesh3D:vertex_positions")
        assert times.tolist() == [5_000_000_000 * k]
        here = np.array(points)[:, 0]
        front = x[(t >= 5 * k) & (t < 5 * (k + 1))] + 1.4
        assert here.max() < front.max() + 0.8
        assert k == 0 or here.min() > front.min() - 1.5


def test_ruts_follow_the_wheel_tracks_in_several_colours(rutted):
    _, (points,) = rutted.column("/world/ruts/1", "Mesh3D:vertex_positions")
    _, (colours,) = rutted.column("/world/ruts/1", "Mesh3D:vertex_colors")
    points = np.array(points)
    assert np.abs(np.abs(points[:, 1]) - 0.5).max() < 0.3
    assert (points[:, 2] > 0).all()
    assert len(set(colours)) > 3
