import numpy as np
import pytest
from recorded import replay

from agrobot_mj.machine.tractor import COMPACT, TractorParameters
from agrobot_mj.recording.world.wheels import Forces, Wheels, contacts
from agrobot_mj.terrain.grid import plane
from agrobot_mj.tyres.patch import WheelMotion, find_patch

WHEELS = ("fl", "fr", "rl", "rr")
LARGE = {"mass_kg": 6000.0, "wheelbase_m": 2.8}
CALM, HARD = 0x4DF08AFF, 0xE02010FF
N_PER_M = 1000.0  # Of the arrows along the ground; those of the loads are half as long


def grid(values):
    """Return an array of shape (ticks, 4, 3)."""
    return np.array(values)


def report(log, quantity):
    return np.stack([log.column(f"{quantity}_{wheel}") for wheel in WHEELS], axis=1)


def test_drawn_contact_patches_and_frames_equal_those_of_the_tyre_model():
    rng = np.random.default_rng(4)
    ground = plane(0.1, -0.2, 50.0)
    quaternions = rng.normal(size=(6, 4, 4)) * 0.15 + [1.0, 0, 0, 0]
    quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
    poses = np.concatenate([rng.uniform(-5, 5, size=(6, 4, 3)), quaternions], axis=-1)
    radii, still = np.array([0.28, 0.28, 0.42, 0.42]), (0.0, 0.0, 0.0)
    poses[..., 2] = 0.1 * poses[..., 0] - 0.2 * poses[..., 1] + radii
    found = contacts(ground, poses, radii)
    for k in range(6):
        for i in range(4):
            w, x, y, z = poses[k, i, 3:]
            axle = 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)
            patch = find_patch(ground, radii[i], WheelMotion(tuple(poses[k, i, :3]), axle, still, still))
            np.testing.assert_allclose(found.forward[k, i], patch.f, atol=1e-9)
            np.testing.assert_allclose(found.left[k, i], patch.l, atol=1e-9)
            np.testing.assert_allclose(found.normal[k, i], patch.n, atol=1e-9)
            arm = found.patch[k, i] - poses[k, i, :3]
            np.testing.assert_allclose(arm / radii[i], np.array(patch.arm) / np.linalg.norm(patch.arm), atol=1e-9)


def test_force_arrows_equal_the_logged_forces_in_world_axes(eight):
    times, along = eight.column("/world/forces/ground", "Arrows3D:vectors")
    _, loads = eight.column("/world/forces/load", "Arrows3D:vectors")
    np.testing.assert_array_equal(times, np.rint(eight.log.column("t") * 1e9))
    fx, fy, load = (report(eight.log, name) for name in ("fx", "fy", "load"))
    # On level ground the rear wheels point along the heading, and loads point up.
    yaw, along = eight.log.column("yaw")[:, None], N_PER_M * grid(along)
    rear = np.s_[:, 2:]
    np.testing.assert_allclose(along[rear][..., 0], (np.cos(yaw) * fx[rear] - np.sin(yaw) * fy[rear]), atol=2.0)
    np.testing.assert_allclose(along[rear][..., 1], (np.sin(yaw) * fx[rear] + np.cos(yaw) * fy[rear]), atol=2.0)
    np.testing.assert_allclose(np.linalg.norm(along, axis=-1), np.hypot(fx, fy), rtol=1e-4, atol=0.01)
    assert np.hypot(fx, fy).max() > 100
    np.testing.assert_allclose(2 * N_PER_M * grid(loads), load[..., None] * [0, 0, 1], rtol=1e-5, atol=1e-3)


def test_front_force_arrows_rotate_with_the_steered_wheels(short, tmp_path):
    for wheel in WHEELS:
        short.column(f"fx_{wheel}")[:], short.column(f"fy_{wheel}")[:] = 0.0, 500.0
    steer, bodies = 0.3, list(short.scene.bodies)
    for wheel in ("fl", "fr"):
        at = bodies.index(f"wheel_{wheel}")
        yaw = short.column("yaw") + steer
        short.rows.poses[:, at, 3:] = 0.0
        short.rows.poses[:, at, 3], short.rows.poses[:, at, 6] = np.cos(yaw / 2), np.sin(yaw / 2)
    _, along = replay(short, tmp_path / "run.rrd").column("/world/forces/ground", "Arrows3D:vectors")
    left = grid(along)[100, :, :2] / 0.5
    heading = short.column("yaw")[100] + np.array([steer, steer, 0.0, 0.0]) + np.pi / 2
    np.testing.assert_allclose(left, np.column_stack([np.cos(heading), np.sin(heading)]), atol=5e-3)


def test_force_arrows_start_at_the_wheels(eight):
    _, starts = eight.column("/world/forces/ground", "Arrows3D:origins")
    _, posts = eight.column("/world/forces/load", "Arrows3D:origins")
    places = [eight.log.poses[:, eight.log.scene.bodies.index(f"wheel_{wheel}"), :3] for wheel in WHEELS]
    centres = np.stack(places, axis=1)
    for origins in (grid(starts), grid(posts)):
        assert (np.abs(origins[..., 2]) < 0.06).all()
        assert np.linalg.norm((origins - centres)[..., :2], axis=-1).max() < 0.25
    yaw = eight.log.column("yaw")[:, None]
    offset = grid(posts) - centres
    leftward = -np.sin(yaw) * offset[..., 0] + np.cos(yaw) * offset[..., 1]
    assert (leftward[:, [0, 2]] > 0.1).all()
    assert (leftward[:, [1, 3]] < -0.1).all()


def test_force_arrow_length_is_relative_to_the_machine_weight(short):
    wheels = Wheels(short.rows, short.scene, short.scenario.terrain.ground())
    small, large = (Forces(wheels, t).arrows(np.arange(5)) for t in (COMPACT, TractorParameters(**LARGE)))
    for k in (1, 3):
        np.testing.assert_allclose(large[k], small[k] * 2.0 * 750.0 / 6000.0)


def test_force_arrow_colours_show_the_fraction_of_friction_in_use(short, tmp_path):
    for i, wheel in enumerate(WHEELS):
        short.column(f"friction_use_{wheel}")[:] = [0.0, 0.97, 0.6, np.nan][i]
    _, colours = replay(short, tmp_path / "run.rrd").column("/world/forces/ground", "Arrows3D:colors")
    assert colours[50] == [CALM, HARD, 0xFFC400FF, CALM]


def test_tyre_marks_are_drawn_behind_the_wheels(eight):
    times, pieces = eight.column("/world/tracks/tyres", "Mesh3D:vertex_positions")
    triangles = np.array(eight.static("/world/tracks/tyres", "Mesh3D:triangle_indices"))
    ends = times // 50_000_000
    assert ends[-1] == len(eight.log.column("t")) - 1
    begins = np.append(0, ends[:-1])
    for wheel, width in enumerate((0.16, 0.16, 0.24, 0.24)):
        body = eight.log.scene.bodies.index(f"wheel_{WHEELS[wheel]}")
        for begin, end, piece in zip(begins, ends, pieces, strict=True):
            left, right = np.array(piece).reshape(-1, 4, 2, 3)[:, wheel].transpose(1, 0, 2)
            np.testing.assert_allclose(np.linalg.norm(left - right, axis=1), width, rtol=1e-3)
            middle = (left + right)[:, :2] / 2
            path = eight.log.poses[:, body, :2]
            np.testing.assert_allclose(middle[[0, -1]], path[[begin, end]], atol=0.02)
            assert (left[:, 2] > 0).all()
            assert (left[:, 2] < 0.01).all()
    corners = np.array(pieces[-1])[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    travelled = eight.log.column("speed")[begins[-1] : ends[-1]].mean() * 0.05 * (ends[-1] - begins[-1])
    assert np.abs(areas).sum() == pytest.approx((0.16 + 0.24) * 2 * travelled, rel=0.05)


def test_tyre_marks_show_wheel_slip_and_loss_of_contact(short, tmp_path):
    short.column("slip_ratio_rl")[:], short.column("slip_angle_rl")[:] = 0.3, 0.0
    short.column("slip_ratio_rr")[:], short.column("slip_angle_rr")[:] = 0.0, 0.0
    short.column("load_fl")[:] = 0.0
    recorded = replay(short, tmp_path / "run.rrd")
    _, colours = recorded.column("/world/tracks/tyres", "Mesh3D:vertex_colors")
    _, pieces = recorded.column("/world/tracks/tyres", "Mesh3D:vertex_positions")
    by_wheel = np.array(colours[20]).reshape(-1, 4, 2)
    assert (by_wheel[:, 2] == HARD).all()
    assert (by_wheel[:, 3] == 0x4A3F2BFF).all()
    places = np.array(pieces[20]).reshape(-1, 4, 2, 3)
    widths = np.linalg.norm(places[:, :, 0] - places[:, :, 1], axis=-1)
    np.testing.assert_allclose(widths, [[0.0, 0.16, 0.24, 0.24]] * len(widths), rtol=1e-3, atol=1e-6)
