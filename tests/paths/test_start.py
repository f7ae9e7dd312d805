"""Initial pose of the tractor: at the start of the path, or offset and rotated from it."""

from math import cos, radians, sin

import pytest

from agrobot_mj.core.geometry import to_heading, wrap
from agrobot_mj.core.spec import every
from agrobot_mj.paths import Line, Path
from agrobot_mj.paths.base import start_of


@pytest.mark.parametrize("kind", every(Path), ids=lambda kind: kind.__name__)
def test_start_keys_offset_and_rotate_the_initial_pose(kind):
    path, moved = kind(), kind(start_offset_m=-1.3, start_heading_deg=25.0)
    assert start_of(path) == path.at(0.0)
    for t in (0.0, 3.3, 40.0):
        assert moved.at(t) == path.at(t)
    on, start = path.at(0.0), start_of(moved)
    assert to_heading(on.yaw, start.x - on.x, start.y - on.y) == pytest.approx((0.0, -1.3), abs=1e-12)
    assert wrap(start.yaw - on.yaw) == pytest.approx(radians(25.0))


def test_positive_start_offset_is_left_of_the_direction_of_travel():
    start = start_of(Line(heading_deg=120.0, start_x_m=5.0, start_offset_m=2.0, start_heading_deg=170.0))
    angle = radians(120.0)
    assert (start.x, start.y) == pytest.approx((5.0 - 2.0 * sin(angle), 2.0 * cos(angle)))
    assert start.yaw == pytest.approx(radians(290.0 - 360.0))
