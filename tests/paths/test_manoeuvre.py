"""Manoeuvre: geometry of its segments, and cross-track error at its cusps."""

from math import pi

import numpy as np
import pytest

from agrobot_mj import load_scenario
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.metrics.crosstrack import track
from agrobot_mj.paths import Manoeuvre, Swaths
from agrobot_mj.paths.manoeuvre import ArcPiece, ClothoidPiece, StraightPiece


def test_default_manoeuvre_ends_in_reverse_in_the_crop_row():
    path = Manoeuvre()
    grid = np.linspace(0, path.duration_s, 4000).tolist()
    u = np.array([r.vx * np.cos(r.yaw) + r.vy * np.sin(r.yaw) for r in map(path.at, grid)])
    end, corner = path.at(path.duration_s), path.at(path.motion.time_at(14.0))
    assert (u.max(), u.min()) == pytest.approx((0.8, -0.8))
    assert end.yaw == pytest.approx(pi / 2, abs=1e-5)
    assert end.vy == pytest.approx(-0.8, abs=1e-5)
    assert end.y < corner.y - 10, "the row is on the other side of the headland"
    assert path.motion.distances[-1] == pytest.approx(14 + 2 * 1.5708 + 4 * np.radians(67.5) + 2 + 22)


def test_manoeuvre_segments_are_joined_and_turn_to_the_specified_side():
    path = Manoeuvre(
        piece=(
            StraightPiece(length_m=5.0),
            ArcPiece(radius_m=4.0, angle_deg=90.0),
            ArcPiece(radius_m=4.0, angle_deg=90.0, side="right", reverse=True),
            ClothoidPiece(length_m=2.0, to_per_m=-0.2, speed_m_s=0.3),
        ),
        heading_deg=90.0,
        start_x_m=2.0,
    )
    x, y, yaw = path.course().joints()
    assert yaw[:5] - yaw[0] == pytest.approx((0, 0, pi / 2, pi / 2, pi))  # the joint of the pause is repeated
    assert (x[2], y[2]) == pytest.approx((-2, 9))
    assert (x[4], y[4]) == pytest.approx((2 + 0.0, 13))
    end = path.at(path.duration_s)
    assert (end.curvature, path.at(path.duration_s - 1e-9).curvature) == pytest.approx((0, -0.2))
    assert np.hypot(end.vx, end.vy) <= 0.3 + 1e-9


def test_manoeuvre_is_unchanged_by_writing_and_reading_a_scenario(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(
        '[path]\nkind = "manoeuvre"\n[[path.piece]]\nkind = "straight"\nlength_m = 8\n'
        '[[path.piece]]\nkind = "arc"\nradius_m = 4\nangle_deg = 30\nreverse = true\nside = "right"\n'
    )
    scenario = load_scenario(file)
    assert [piece.kind for piece in scenario.path.piece] == ["straight", "arc"]
    (tmp_path / "again.toml").write_text(scenario.to_toml())
    assert load_scenario(tmp_path / "again.toml").path == scenario.path
    file.write_text('[path]\nkind = "manoeuvre"\n[[path.piece]]\nkind = "arc"\nradius_m = 4\nreverse = 1\n')
    with pytest.raises(ScenarioError, match=r"path\.piece\[0\].*angle_deg"):
        load_scenario(file)


@pytest.mark.parametrize(
    "path", [Manoeuvre(), Swaths(turn="k", length_m=40), Swaths(turn="k", length_m=40, transition="clothoid")], ids=repr
)
@pytest.mark.parametrize("left", [-0.3, 0.0, 0.3])
def test_cross_track_error_is_continuous_at_a_cusp(path, left):
    """The error of a tractor with constant lateral offset equals this offset, also at cusps."""
    t = np.arange(0, path.duration_s, 0.05)
    r = np.array([path.at(time) for time in t.tolist()])
    found = track(path, t, r[:, 0] - left * np.sin(r[:, 4]), r[:, 1] + left * np.cos(r[:, 4]))
    assert found.offset == pytest.approx(left, abs=0.02)
