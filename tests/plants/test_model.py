"""Compiled MJCF model compared with the tractor parameters."""

import re

import mujoco
import numpy as np
import pytest

from agrobot_mj.core.resources import MODELS
from agrobot_mj.machine import Machine
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.mujoco.model import (
    ackermann_coefficients,
    simulation_model,
    tractor_spec,
)
from agrobot_mj.terrain import Flat

HEAVY = TractorParameters(
    mass_kg=980,
    wheelbase_m=1.6,
    track_m=1.2,
    front_load_fraction=0.42,
    cg_height_m=0.7,
    pitch_inertia_kg_m2=480,
    yaw_inertia_kg_m2=520,
)


def written(tractor):
    spec = tractor_spec(Machine(tractor))
    return simulation_model(spec, Flat().ground(), 0.002, None)


def as_shipped(tractor):
    return mujoco.MjSpec.from_file(str(MODELS / "tractor.xml")).compile()


def inertia_about_cg(model):
    """Return model data with all joints at zero, and the inertia (3, 3) of the tractor about its CG in world axes."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    total = np.zeros((3, 3))
    for b in range(1, model.nbody):
        R = data.ximat[b].reshape(3, 3)
        d = data.xipos[b] - data.subtree_com[1]
        total += R @ np.diag(model.body_inertia[b]) @ R.T
        total += model.body_mass[b] * (d @ d * np.eye(3) - np.outer(d, d))
    return data, total


@pytest.mark.parametrize(
    ("make", "tractor", "rel"),
    [(as_shipped, TractorParameters(), 1e-4), (written, TractorParameters(), 1e-9), (written, HEAVY, 1e-9)],
    ids=["tractor.xml", "default", "heavy"],
)
def test_masses_inertia_and_geometry_equal_the_parameters(make, tractor, rel):
    model = make(tractor)
    data, inertia = inertia_about_cg(model)
    assert model.body_subtreemass[1] == pytest.approx(tractor.mass_kg, rel=rel)
    cg = [tractor.cg_to_rear_axle, 0.0, tractor.cg_height_m]
    assert data.subtree_com[1] == pytest.approx(np.array(cg), abs=10 * rel)
    assert data.site("cg").xpos == pytest.approx(np.array(cg), abs=10 * rel)
    assert data.site("antenna").xpos == pytest.approx(np.array([0, 0, tractor.antenna_height_m]))
    wanted = [tractor.roll_inertia_kg_m2, tractor.pitch_inertia_kg_m2, tractor.yaw_inertia_kg_m2]
    assert inertia == pytest.approx(np.diag(wanted), abs=10 * rel * max(wanted))
    wheels = np.array([data.body(f"wheel_{w}").xpos for w in ("fl", "fr", "rl", "rr")])
    assert wheels[0, 0] - wheels[2, 0] == pytest.approx(tractor.wheelbase_m)
    assert wheels[0, 1] - wheels[1, 1] == pytest.approx(tractor.track_m)
    assert wheels[2, 1] - wheels[3, 1] == pytest.approx(tractor.track_m)
    sink = [wheel.deflection for wheel in tractor.wheels]
    assert wheels[0, 2] == pytest.approx(tractor.front_wheel_radius_m - sink[0], abs=1e-5)
    assert wheels[2, 2] == pytest.approx(tractor.rear_wheel_radius_m - sink[1], abs=1e-5)


def test_values_in_the_xml_files_equal_the_parameters():
    shipped, default = as_shipped(TractorParameters()), written(TractorParameters())
    for name in ("steering", "drive"):
        a, b = shipped.actuator(name), default.actuator(name)
        assert a.gainprm == pytest.approx(b.gainprm)
        assert a.biasprm == pytest.approx(b.biasprm)
        assert a.forcerange == pytest.approx(b.forcerange, rel=1e-3)
    for name in ("ackermann_fl", "ackermann_fr"):
        assert shipped.equality(name).data[:5] == pytest.approx(default.equality(name).data[:5], abs=1e-6)
    assert shipped.joint("steer").range == pytest.approx(default.joint("steer").range)
    assert shipped.joint("axle_roll").range == pytest.approx(default.joint("axle_roll").range)


def test_steering_knuckles_follow_ackermann_geometry():
    tractor = TractorParameters()
    c = ackermann_coefficients(tractor)
    delta = np.linspace(-0.75, 0.75, 31)
    left, right = c @ delta ** np.arange(5)[:, None], -(c @ (-delta) ** np.arange(5)[:, None])
    mean_cot = (1 / np.tan(left[delta != 0]) + 1 / np.tan(right[delta != 0])) / 2
    assert np.arctan(1 / mean_cot) == pytest.approx(delta[delta != 0], abs=np.radians(0.4))
    inner, outer = left[-1], right[-1]
    assert 1 / np.tan(outer) - 1 / np.tan(inner) == pytest.approx(tractor.track_m / tractor.wheelbase_m, abs=0.02)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass_kg": 100.0, "rear_wheel_mass_kg": 45.0, "front_wheel_mass_kg": 18.0}, "mass_kg"),
        ({"yaw_inertia_kg_m2": 40.0}, "inertia"),
        ({"roll_inertia_kg_m2": 900.0}, "inertia"),
    ],
)
def test_tractor_with_impossible_parameters_is_rejected(change, message):
    with pytest.raises(ValueError, match=message):
        written(TractorParameters(**change))


def test_error_for_impossible_inertias_suggests_possible_inertias():
    """The error suggests the inertias of a tractor of the same shape: 16 times the default at twice the length."""
    with pytest.raises(ValueError, match=r"set them to") as refused:
        written(TractorParameters(mass_kg=3000, wheelbase_m=2.8, yaw_inertia_kg_m2=100.0))
    found = [float(x) for x in re.findall(r"([\d.e+]+)(?:,| and| for)", str(refused.value).partition("set them to")[2])]
    assert found == pytest.approx([16 * 120, 16 * 340, 16 * 400], rel=1e-3)
    keys = ("roll_inertia_kg_m2", "pitch_inertia_kg_m2", "yaw_inertia_kg_m2")
    written(TractorParameters(mass_kg=3000, wheelbase_m=2.8, **dict(zip(keys, found, strict=True))))


def test_tractor_in_the_scene_file_responds_to_the_viewer_sliders():
    model = mujoco.MjModel.from_xml_path(str(MODELS / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 500)
    data.ctrl[:] = [0.0, 1.2 / 0.42]
    mujoco.mj_step(model, data, 2000)
    data.ctrl[0] = 0.1
    mujoco.mj_step(model, data, 1500)
    data.ctrl[0] = 0.0
    mujoco.mj_step(model, data, 1500)
    speed = np.hypot(*data.qvel[:2])
    steer = data.joint("steer").qpos[0]
    assert speed == pytest.approx(1.2, rel=0.05)
    assert steer == pytest.approx(0.3, abs=0.02)
    yaw_rate = data.qvel[5]
    assert yaw_rate == pytest.approx(1.2 * np.tan(steer) / 1.4, rel=0.1)
    assert not any(warning.number for warning in data.warning)


def test_scene_file_has_cameras_an_initial_pose_and_a_framebuffer_size():
    model = mujoco.MjModel.from_xml_path(str(MODELS / "scene.xml"))
    assert {model.camera(i).name for i in range(model.ncam)} == {"three_quarter", "side", "rear", "above"}
    assert (model.vis.global_.offwidth, model.vis.global_.offheight) == (1920, 1080)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("ready").id)
    start = data.qpos.copy()
    mujoco.mj_step(model, data, 1000)
    assert data.qpos == pytest.approx(start, abs=1e-3)  # it stands at rest
