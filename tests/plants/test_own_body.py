"""User-defined body of a machine: the template moves like the default tractor, its numbers come from the file, and
an invalid body is rejected in one message."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
import tomli_w

from agrobot_mj import load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.machine.tractor import COMPACT
from agrobot_mj.plants.mujoco.own_body import measures

TEMPLATE = Path(__file__).parents[2] / "examples" / "own_body.xml"
TRACTOR = Path(__file__).parents[2] / "models" / "tractor.xml"
SPHERE = '<geom size="0.1" mass="5"/>'


def variant(tmp_path, *changes, name="mine.xml"):
    """Write the template with replaced texts, each of which must occur in it."""
    text = TEMPLATE.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def refused(path):
    """Return the error message for a body file."""
    with pytest.raises(ScenarioError) as error:
        load_scenario("straight_line", {"tractor.mjcf": str(path)})
    assert all("tractor.mjcf: " in line for line in str(error.value).split("\n"))
    return str(error.value)


def driven(name, seconds, **more):
    return run(load_scenario(name, {"duration_s": seconds} | more))


def test_body_template_gives_the_default_parameters():
    found = measures(str(TEMPLATE), {})
    for key, value in found.items():
        assert value == pytest.approx(getattr(COMPACT, key), rel=1e-6), key
    assert len(found) == 15


@pytest.mark.parametrize("scenario", ["figure_eight", "side_slope_10"])
def test_run_with_the_body_template_agrees_with_the_default_tractor(scenario):
    """Results differ slightly, because masses are rounded to nine digits and 0.5 kg of the crank belong to the axle.

    The test uses the gains of the paper, because a network with a higher learning rate would amplify the difference.
    """
    mine, default = (driven(scenario, 30.0, gains="paper", **keys) for keys in ({"tractor.mjcf": str(TEMPLATE)}, {}))
    for name, bound in (("x", 1e-3), ("y", 1e-3), ("yaw", 1e-3), ("steer", 2e-3), ("roll", 1e-4)):
        assert np.abs(mine.column(name) - default.column(name)).max() < bound, name
    load = np.array([mine.column(f"load_{w}") - default.column(f"load_{w}") for w in ("fl", "fr", "rl", "rr")])
    assert np.abs(load).max() < 20.0


def test_model_file_of_the_default_tractor_is_a_valid_body_file(tmp_path):
    """The actuators, couplings, crank and differentials of the file are omitted or replaced."""
    text = re.sub(r".*<include.*\n", "", TRACTOR.read_text(encoding="utf-8"))
    (tmp_path / "tractor.xml").write_text(text, encoding="utf-8")
    mine = driven("figure_eight", 10.0, **{"tractor.mjcf": str(tmp_path / "tractor.xml")})
    default = driven("figure_eight", 10.0)
    assert np.abs(mine.column("y") - default.column("y")).max() < 1e-3


def test_masses_computed_from_geoms_are_kept_when_geoms_are_removed(tmp_path):
    box = '<geom name="load" type="box" size="0.2 0.2 0.1" pos="0.2 0 0.9" mass="100"/>\n'
    path = variant(tmp_path, ('<geom name="hood_contact"', f'<body name="rack">{box}</body><geom name="hood_contact"'))
    found = measures(str(path), {})
    share = (750 * 0.532 + 100 * 0.2) / 850
    assert found["mass_kg"] == pytest.approx(850.0)
    assert found["front_load_fraction"] == pytest.approx(share / 1.4, rel=1e-6)
    sinks = 850 * (1 - share / 1.4) * 9.81 / 2 / COMPACT.rear_wheel.stiffness  # both at the minimum pressure
    above = 0.42 - sinks - 0.39649501
    assert found["cg_height_m"] == pytest.approx((750 * 0.55 + 100 * 0.9) / 850 + above, rel=1e-6)
    log = driven("straight_line", 3.0, **{"tractor.mjcf": str(path)})
    loads = sum(log.column(f"load_{w}")[40:].mean() for w in ("fl", "fr", "rl", "rr"))
    assert loads == pytest.approx(850 * 9.81, rel=0.01)
    assert {geom.name for geom in log.scene.geoms} >= {"load", "tyre_fl", "lug_fl_0"}
    assert "hood" not in {geom.name for geom in log.scene.geoms}


def test_body_file_in_radians_or_without_an_axle_pivot_is_accepted(tmp_path):
    path = variant(
        tmp_path,
        ('angle="degree"', 'angle="radian"'),
        ('range="-70 70"', 'range="-1.2217 1.2217"'),
        ('<joint name="axle_roll" axis="1 0 0" pos="0 0 0.0504" range="-10 10" damping="20"/>', ""),
        ("</mujoco>", '<option gravity="0 0 -3" timestep="0.01"/></mujoco>'),
    )
    assert "axle_pivot_limit_deg" not in measures(str(path), {})
    implement = {"implement.kind": "drawn", "implement.mass_kg": 300.0}
    log = driven("straight_line", 5.0, **{"tractor.mjcf": str(path)}, **implement)
    default = driven("straight_line", 5.0, **implement)
    assert np.abs(log.column("x") - default.column("x")).max() < 0.02
    assert log.column("load_rl")[-1] == pytest.approx(default.column("load_rl")[-1], rel=0.02)


def test_mesh_file_next_to_the_body_file_is_drawn_and_copied(tmp_path):
    (tmp_path / "shed.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    asset = '<asset><mesh name="shed" file="shed.obj"/></asset>\n\n  <worldbody>'
    shed = '<geom name="shed" type="mesh" mesh="shed" pos="0 0 1"/>\n      <geom name="hood_contact"'
    path = variant(tmp_path, ("<worldbody>", asset), ('<geom name="hood_contact"', shed))
    scenario = load_scenario("straight_line", {"tractor.mjcf": str(path), "duration_s": 1.0})
    (drawn,) = [geom for geom in run(scenario).scene.geoms if geom.kind == "mesh"]
    assert (drawn.mesh.vertices.shape, drawn.mesh.triangles.shape) == ((4, 3), (4, 3))
    assert set(scenario.portable()[1]) == {"mine.xml", "shed.obj"}
    before = scenario.hash8
    (tmp_path / "shed.obj").write_text("v 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    assert scenario.hash8 != before


def test_body_file_path_is_relative_to_the_machine_file(tmp_path):
    variant(tmp_path)
    (tmp_path / "machine.toml").write_text('[tractor]\nmjcf = "mine.xml"\n', encoding="utf-8")
    scenario = load_scenario("straight_line", {"machine": str(tmp_path / "machine.toml")})
    assert Path(scenario.tractor.mjcf) == tmp_path / "mine.xml"
    assert scenario.tractor.mass_kg == pytest.approx(750.0)


def test_resolved_scenario_with_a_custom_body_runs_again(tmp_path):
    scenario = load_scenario("straight_line", {"tractor.mjcf": str(variant(tmp_path)), "duration_s": 1.0})
    (tmp_path / "again.toml").write_text(scenario.to_toml(), encoding="utf-8")
    again = load_scenario(tmp_path / "again.toml")
    assert again.tractor == scenario.tractor
    assert again.hash8 == scenario.hash8


def test_key_that_contradicts_the_body_file_is_rejected(tmp_path):
    path = variant(tmp_path)
    with pytest.raises(ScenarioError, match=r"tractor\.mass_kg: the body of mine\.xml has 750, got 800; omit the key"):
        load_scenario("straight_line", {"tractor.mjcf": str(path), "tractor.mass_kg": 800})
    same = load_scenario("straight_line", {"tractor.mjcf": str(path), "tractor.mass_kg": 750.0})
    assert same.tractor.antenna_height_m == pytest.approx(2.0)


def test_error_for_an_impossible_tyre_does_not_name_the_body_file(tmp_path):
    with pytest.raises(ScenarioError, match=r"tractor\.rear_tyre_stiffness_n_m: ") as error:
        load_scenario("straight_line", {"tractor.mjcf": str(variant(tmp_path)), "tractor.rear_tyre_stiffness_n_m": 0})
    assert "mine.xml" not in str(error.value)


def test_all_missing_quantities_of_a_body_file_are_reported_together(tmp_path):
    path = variant(tmp_path, ('"spin_rl"', '"left"'), ('"tyre_fr"', '"rubber"'), ('"steer_fl"', '"kingpin"'))
    message = refused(path)
    for missing in ("joint 'spin_rl'", "geom 'tyre_fr'", "joint 'steer_fl'"):
        assert f"there is no {missing}" in message


CHASSIS_GEOM = '<geom name="hood_contact"'


def on_chassis(name, joint=""):
    """Return a text replacement that attaches a body to the chassis."""
    return CHASSIS_GEOM, f'<body name="{name}" pos="0.7 0.5 0.3">{joint}{SPHERE}</body>{CHASSIS_GEOM}'


def before_world(text):
    return "<worldbody>", f"{text}<worldbody>"


LIGHT = [(f'mass="{kg}"', 'mass="1"') for kg in (45, 25.5, 18, 4, 590.5)]
LIGHT.append(("69.03158172 241.0725447 280.777059 0 -10.76194276 0", "1 1 1 0 0 0"))
AHEAD = [(f'pos="0 {y} 0.39649501"', f'pos="0.3 {y} 0.39649501"') for y in (0.5, -0.5)]
WRONG = {
    "six wheels": ([on_chassis("middle", '<joint name="mid" axis="0 1 0"/>')], "only machines on four wheels"),
    "axis": ([('axis="0 1 0" armature', 'axis="0 -1 0" armature')], "axis points to the left"),
    "kingpin": ([('<joint axis="0 0 1"', '<joint axis="0 0 -1"')], "axis points up"),
    "fixed": ([("<freejoint/>", "")], "freejoint"),
    "tyre": ([('<geom type="cylinder" quat', '<geom type="capsule" quat')], "must be a cylinder"),
    "tyre across": ([('quat="1 1 0 0"', 'quat="1 0 0 0"')], "must be a cylinder on the axis"),
    "tyre beside": ([('"tyre_rl"', '"tyre_rl" pos="0 0.2 0"')], "in the middle of 'wheel_rl'"),
    "origin": (AHEAD, "origin of the chassis must be below"),
    "height": ([("0.39649501", "0.2")], "origin of the chassis must be on the ground"),
    "sides": ([('"wheel_rl" pos="0 0.5', '"wheel_rl" pos="0 0.6')], "must be mirror images"),
    "sizes": ([('"tyre_rl" size="0.42', '"tyre_rl" size="0.40')], "have the same size"),
    "loose": ([on_chassis("arm", '<joint name="loose" range="-9 9"/>')], "'loose' moves freely"),
    "beside": (
        [('<body name="chassis">', f'<body name="tree">{SPHERE}</body><body name="chassis">')],
        "is not attached to the chassis",
    ),
    "lopsided": ([("0.51092295 0 0.60734014", "0.51092295 0.4 0.60734014")], "off the middle"),
    "reserved": ([on_chassis("implement")], "choose another"),
    "light": (LIGHT, "gives mass_kg, which must be at least 50"),
    "total": ([('autolimits="true"', 'autolimits="true" settotalmass="900"')], "set the masses of the bodies instead"),
    "not a number": ([('mass="590.5"', 'mass="nan"')], "<inertial mass>: must be finite numbers"),
    "infinite": ([('pos="1.4 0 0.26159854"', 'pos="inf 0 0.2"')], "<body pos>: must be finite numbers"),
    "no mesh": ([before_world('<asset><mesh name="a" file="a.stl"/></asset>')], "a.stl: no such file"),
    "outside": ([before_world('<include file="../secret.xml"/>')], "must be in the folder of the body"),
    "absolute": ([before_world('<include file="/etc/passwd"/>')], "must be in the folder of the body"),
    "folder": ([('angle="degree"', 'angle="degree" meshdir="/etc"')], "<compiler meshdir>"),
    "plugin": ([before_world('<extension><plugin plugin="x"/></extension>')], "plugins are not supported"),
    "unknown": ([before_world("<wheels/>")], "MuJoCo cannot read the file"),
}


@pytest.mark.parametrize("case", WRONG)
def test_error_for_an_invalid_body_file_names_the_faulty_part(case, tmp_path):
    changes, expected = WRONG[case]
    assert expected in refused(variant(tmp_path, *changes))


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("", "is empty"),
        ("hello", "is not valid XML"),
        ("<robot/>", "begins with <robot>"),
        ("<mujoco>", "is not valid XML"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', "document type"),
        ("<mujoco/>", "there is no body 'chassis'"),
        ("\0\0\0", "is not valid XML"),
        ("<mujoco><worldbody>" + 5000 * "<body>" + 5000 * "</body>" + "</worldbody></mujoco>", "cannot read the file"),
    ],
)
def test_file_that_is_not_mjcf_is_rejected(content, expected, tmp_path):
    path = tmp_path / "mine.xml"
    path.write_text(content, encoding="utf-8")
    assert expected in refused(path)


def test_unusable_body_file_paths_are_rejected_with_a_reason(tmp_path):
    assert "is a folder" in refused(tmp_path)
    assert "no such file" in refused(tmp_path / "none.xml")
    (tmp_path / "device.xml").symlink_to("/dev/zero")
    assert "not a regular file" in refused(tmp_path / "device.xml")
    (tmp_path / "mine.urdf").write_text("<robot/>")
    assert "unknown file type" in refused(tmp_path / "mine.urdf")
    loop = variant(tmp_path, ("<worldbody>", '<include file="loop.xml"/><worldbody>'), name="loop.xml")
    assert "includes or attaches itself" in refused(loop)


def test_command_reports_an_invalid_body_file_and_writes_nothing(tmp_path, call):
    path = variant(tmp_path, ('"steer_fl"', '"kingpin"'))
    (tmp_path / "s.toml").write_text(tomli_w.dumps({"tractor": {"mjcf": path.name}}), encoding="utf-8")
    status, _, told = call("run", str(tmp_path / "s.toml"), "--out", str(tmp_path / "out"))
    assert status == 2
    assert "tractor.mjcf: mine.xml: there is no joint 'steer_fl'" in told
    assert "Traceback" not in told
    assert not (tmp_path / "out").exists()


def test_keys_that_conflict_with_kingpins_or_steering_stops_are_rejected(tmp_path):
    narrow = variant(tmp_path, ('range="-70 70"', 'range="-50 50"'))
    with pytest.raises(
        ScenarioError, match=r"tractor\.steer_limit_deg: .* joint 'steer_fl' of the body stops at 50\.0"
    ):
        driven("straight_line", 1.0, **{"tractor.mjcf": str(narrow)})
    assert driven("straight_line", 1.0, **{"tractor.mjcf": str(narrow), "tractor.steer_limit_deg": 35.0})
    with pytest.raises(ScenarioError, match=r"steering\.linkage: the body of tractor\.mjcf has its own kingpins"):
        driven("straight_line", 1.0, **{"tractor.mjcf": str(TEMPLATE), "steering.linkage.caster_deg": 5.0})


def test_body_template_opens_in_the_mujoco_viewer():
    model = mujoco.MjModel.from_xml_path(str(TEMPLATE))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 10)
    assert not any(warning.number for warning in data.warning)
