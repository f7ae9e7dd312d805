"""Pass-to-pass errors of straight and curved swaths with known lateral errors."""

import numpy as np
import pytest

from agrobot_mj.extensions.fields.boom import ImplementMotion
from agrobot_mj.extensions.fields.operations import WorkedPass, pass_to_pass
from agrobot_mj.extensions.fields.plan import Plan
from agrobot_mj.extensions.fields.planned import planned_motion
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.track import Piece

SPACING = 3.0


def motion(x, y, yaw, reverse=False):
    """Return the motion along points, in the opposite direction if `reverse`."""
    parts = [np.asarray(each, dtype=float)[:: -1 if reverse else 1] for each in (x, y, yaw)]
    t = np.linspace(0.0, 1.0, len(parts[0]))
    return ImplementMotion(t, parts[0], parts[1], parts[2] + np.pi * reverse, t)


def straight(offset, error, reverse=False, angle=0.4):
    """Return a straight swath at a lateral offset, and a motion whose offset is larger by `error`."""
    s = np.linspace(0.0, 60.0, 601)
    c, d = np.cos(angle), np.sin(angle)
    lines = [motion(c * s - d * o, d * s + c * o, np.full(601, angle), reverse) for o in (offset, offset + error)]
    return WorkedPass(*lines)


def arc(radius, error, reverse=False):
    """Return a swath on an arc about the origin, and a motion on an arc whose radius is larger by `error`."""
    angle = np.linspace(0.0, 1.5, 1501)
    rings = [motion(r * np.cos(angle), r * np.sin(angle), angle + np.pi / 2, reverse) for r in (radius, radius + error)]
    return WorkedPass(*rings)


@pytest.mark.parametrize("reverse", [(False, False, False), (False, True, False), (True, False, True)])
@pytest.mark.parametrize("shape", [straight, arc])
def test_pass_to_pass_error_is_the_difference_of_the_lateral_errors(shape, reverse):
    offsets = (20.0, 20.0 + SPACING, 20.0 + 2 * SPACING)
    passes = [shape(o, e, r) for o, e, r in zip(offsets, (0.05, 0.02, 0.12), reverse, strict=True)]
    for order in (passes, passes[::-1]):
        found = pass_to_pass(order, SPACING)
        assert found["pass_to_pass_p95_m"] == pytest.approx(0.1, abs=1e-3)
        assert found["pass_to_pass_mean_m"] == pytest.approx(0.035, abs=5e-3)
        assert found["cross_track_p95_m"] == pytest.approx(0.12, abs=1e-3)


@pytest.mark.parametrize("shape", [straight, arc])
def test_passes_farther_apart_than_the_swath_width_are_not_compared(shape):
    found = pass_to_pass([shape(20.0, 0.0), shape(20.0 + 2 * SPACING, 0.1)], SPACING)
    assert found["pass_to_pass_p95_m"] is None
    assert pass_to_pass([shape(20.0, 0.0), shape(22.5, 0.1)], 2.5)["pass_to_pass_p95_m"] == pytest.approx(0.1, abs=1e-3)


def test_pass_to_pass_error_ignores_parts_without_a_neighbouring_pass():
    long, s = straight(0.0, 0.0, angle=0.0), np.linspace(40.0, 90.0, 501)
    late = WorkedPass(*(motion(s, np.full(501, SPACING + e), np.zeros(501)) for e in (0.0, 0.07)))
    found = pass_to_pass([long, late], SPACING)
    assert found["pass_to_pass_mean_m"] == pytest.approx(0.07)
    assert pass_to_pass([long], SPACING)["pass_to_pass_p95_m"] is None
    assert pass_to_pass([], SPACING)["cross_track_p95_m"] is None


def test_oblique_passes_are_not_compared():
    passes = [straight(0.0, 0.0), *(straight(SPACING, 0.3, angle=angle) for angle in (0.7, 1.4, 2.5))]
    assert pass_to_pass(passes, SPACING)["pass_to_pass_p95_m"] is None


@pytest.mark.parametrize(("behind", "length"), [(2.5, 1.0), (1.0, 1.0), (2.5, 0.0)])
def test_planned_implement_follows_the_closed_form_on_an_arc(behind, length):
    """The rear axle is `length` behind the CG and points to the centre; the implement is in line with both."""
    radius = 20.0
    plan = Plan("arc", 3.0, behind, length, Pose(radius, 0.0, np.pi / 2), (Piece(60.0, 1 / radius),), ())
    found = planned_motion(plan)
    expected = np.hypot(np.sqrt(radius**2 - length**2), behind - length)
    assert np.hypot(found.x, found.y)[-1] == pytest.approx(expected, abs=1e-6)


def test_repeated_point_of_a_planned_swath_does_not_change_its_errors():
    one, other = straight(20.0, 0.0), straight(20.0 + SPACING, 0.1)
    short = WorkedPass(*(ImplementMotion(*(values[:300] for values in each)) for each in other))
    planned = ImplementMotion(*(np.append(values, values[-1]) for values in short.planned))
    with np.errstate(invalid="raise"):
        assert pass_to_pass([one, short._replace(planned=planned)], SPACING) == pass_to_pass([one, short], SPACING)
