"""Displayed body: it fits machines of any size, has no mass, and is the same in MuJoCo's viewer and in a recording."""

from math import cos, pi, sin

import mujoco
import numpy as np
import pytest
from drawn_models import files
from hypothesis import assume, given
from hypothesis import strategies as st

from agrobot_mj import load_scenario, run
from agrobot_mj.core.resources import MODELS
from agrobot_mj.machine import Machine
from agrobot_mj.machine.tractor import COMPACT, TractorParameters
from agrobot_mj.plants.mujoco.bodywork import KINDS, bodies
from agrobot_mj.plants.mujoco.drawing import scene_of
from agrobot_mj.plants.mujoco.model import tractor_spec

STYLES = ("open", "roll_bar", "cab", "robot")
SPARE_M = 0.002


@st.composite
def machines(draw):
    """Return a machine between a small mower and the largest tractor, whose wheels do not intersect."""
    L = draw(st.floats(1.2, 3.5))
    T = draw(st.floats(0.45, 0.9)) * L
    rear = draw(st.floats(0.17, 0.40)) * L
    front = draw(st.floats(0.5, 1.0)) * rear
    widths = [draw(st.floats(0.3, 0.8)) * r for r in (front, rear)]
    assume(np.hypot(front, widths[0] / 2) + rear < 0.85 * L)
    assume(T / 2 - widths[1] / 2 > 0.15 * T)
    return TractorParameters(
        mass_kg=750.0 * (L / 1.4) ** 3,
        **{"wheelbase_m": L, "track_m": T, "front_wheel_radius_m": front, "rear_wheel_radius_m": rear},
        **{"front_wheel_width_m": widths[0], "rear_wheel_width_m": widths[1]},
        antenna_height_m=draw(st.floats(0.5, 4.0)),
        body=draw(st.sampled_from(STYLES)),
    )


def tyre_points(t, front, angle):
    """Return points on the surface of a left tyre steered by `angle`, in the chassis frame, shape (n, 3) [m]."""
    end = "front" if front else "rear"
    r, w = getattr(t, f"{end}_wheel_radius_m"), getattr(t, f"{end}_wheel_width_m")
    turns = np.linspace(0, 2 * pi, 48, endpoint=False)
    rings = [(k * r, y) for k in (1.0, 0.8) for y in (-w / 2, -w / 4, 0.0, w / 4, w / 2)]
    disc = np.array([(k * cos(a), y, k * sin(a)) for k, y in rings for a in turns])
    c, s = cos(angle), sin(angle)
    turned = disc @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return turned + [t.wheelbase_m if front else 0.0, t.track_m / 2, r]


def inside(part, points):
    """Return which of the points (n, 3) are inside a part by more than a rounding error."""
    if part.ends:
        a, b = np.array(part.ends[:3]), np.array(part.ends[3:])
        along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        return np.linalg.norm(points - a - along[:, None] * (b - a), axis=1) < part.size[0] - SPARE_M
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.array(part.quat))
    local = (points - part.pos) @ matrix.reshape(3, 3)
    if part.kind == "box":
        return (np.abs(local) < np.array(part.size) - SPARE_M).all(axis=1)
    if part.kind == "cylinder":
        return (np.hypot(local[:, 0], local[:, 1]) < part.size[0]) & (np.abs(local[:, 2]) < part.size[1] - SPARE_M)
    half = np.array(part.size * 3 if part.kind == "sphere" else part.size)
    return ((local / half) ** 2).sum(axis=1) < 1


def extremes(part):
    """Return the lowest and the highest corner of the bounding box of a part, shape (3,) each."""
    if part.ends:
        ends = np.array(part.ends).reshape(2, 3)
        return ends.min(axis=0) - part.size[0], ends.max(axis=0) + part.size[0]
    matrix, size = np.empty(9), part.size
    mujoco.mju_quat2Mat(matrix, np.array(part.quat))
    half = {"box": size, "ellipsoid": size, "sphere": size * 3, "cylinder": (size[0], size[0], size[-1])}[part.kind]
    reach = np.abs(matrix.reshape(3, 3)) @ half
    return part.pos - reach, part.pos + reach


@given(machines())
def test_wheels_do_not_intersect_the_bodywork_at_any_steering_angle(t):
    body = bodies(t)["chassis"]
    angles = np.linspace(-1.2, 1.2, 9)
    points = np.concatenate([tyre_points(t, True, a) for a in angles] + [tyre_points(t, False, 0.0)])
    both = np.concatenate([points, points * [1, -1, 1]])
    assert [part.name for part in body if inside(part, both).any()] == []


@given(machines())
def test_bodywork_is_above_the_ground_and_within_the_tyre_outlines(t):
    low, high = (np.array(v) for v in zip(*map(extremes, bodies(t)["chassis"]), strict=True))
    assert low[:, 2].min() > 0.1 * t.rear_wheel_radius_m
    assert low[:, 0].min() > -1.5 * t.rear_wheel_radius_m - 0.1
    assert high[:, 0].max() < t.wheelbase_m + t.front_wheel_radius_m
    assert np.abs([low[:, 1], high[:, 1]]).max() <= t.track_m / 2 + t.rear_wheel_width_m / 2 + 0.06


@given(machines())
def test_every_body_part_has_a_size_and_a_unique_name(t):
    drawn = [part for body in bodies(t).values() for part in body]
    assert len({part.name for part in drawn}) == len(drawn)
    assert all(value > 0 for part in drawn for value in part.size)
    assert all(np.isfinite([*part.size, *part.pos, *part.quat, *part.ends]).all() for part in drawn)


@pytest.mark.parametrize(
    ("mass", "style"), [(330.0, "open"), (750.0, "roll_bar"), (1500.0, "roll_bar"), (5000.0, "cab"), (9000.0, "cab")]
)
def test_body_style_is_selected_by_mass_unless_specified(mass, style):
    t = COMPACT.model_copy(update={"mass_kg": mass})
    assert t.style == style
    assert t.model_copy(update={"body": "robot"}).style == "robot"
    names = {part.name for part in bodies(t)["chassis"]}
    assert ("seat" in names, "rollbar_top" in names, "roof" in names) == (
        style != "cab",
        style == "roll_bar",
        style == "cab",
    )


def test_body_style_does_not_change_the_simulation_result():
    logs = [run(load_scenario("figure_eight", {"duration_s": 5.0, "tractor.body": body})) for body in STYLES]
    for log in logs[1:]:
        assert log.signals.equals(logs[0].signals)


def test_contact_geoms_of_the_default_tractor_equal_its_model_file():
    shipped, written = (
        mujoco.MjSpec.from_file(str(MODELS / "tractor.xml")).compile(),
        tractor_spec(Machine(COMPACT)).compile(),
    )
    for name in ("hood_contact", "rollbar_contact"):
        for key in ("size", "pos", "quat"):
            np.testing.assert_array_equal(getattr(shipped.geom(name), key), getattr(written.geom(name), key))


def test_contact_geoms_scale_with_the_size_of_the_body():
    large = TractorParameters(wheelbase_m=2.8, mass_kg=6000.0)
    model = tractor_spec(Machine(large)).compile()
    hood, roof = model.geom("hood_contact"), model.geom("rollbar_contact")
    assert hood.pos[0] + hood.size[0] == pytest.approx(2 * 1.56)
    drawn = {part.name: part for part in bodies(large)["chassis"]}
    assert roof.pos[2] == pytest.approx(drawn["roof"].pos[2], abs=0.15)


def test_viewer_model_files_are_up_to_date():
    for path, text in files().items():
        assert path.read_text(encoding="utf-8") == text, "run `make reference`"


def test_recording_and_mujoco_viewer_show_equal_geometry():
    shipped = scene_of(mujoco.MjSpec.from_file(str(MODELS / "tractor.xml")).compile())
    written = scene_of(tractor_spec(Machine(COMPACT)).compile())
    ours = {geom.name: geom for geom in written.geoms}
    assert {geom.name for geom in shipped.geoms} == set(ours)
    for geom in shipped.geoms:
        other = ours[geom.name]
        assert (geom.kind, geom.body, geom.rgba) == (other.kind, other.body, other.rgba)
        assert geom.kind in KINDS
        np.testing.assert_allclose([*geom.size, *geom.pos], [*other.size, *other.pos], atol=2e-3)
