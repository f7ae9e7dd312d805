"""Implausible values are rejected with key, value and limit, or reported; expensive inputs are counted first."""

from types import SimpleNamespace

import numpy as np
import pytest
from removed import is_there

import agrobot_mj
from agrobot_mj import load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.geometry import in_polygon
from agrobot_mj.scenario.hints import hints
from agrobot_mj.simulation.api import ScenarioWarning
from agrobot_mj.simulation.outcomes import Watch
from agrobot_mj.terrain.shapes import PolygonPatch


def refused(source="straight_line", **overrides):
    with pytest.raises(ScenarioError) as error:
        load_scenario(source, {key.replace("__", "."): value for key, value in overrides.items()})
    return str(error.value)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("steering.cylinder.rod_mm", 100.0, "must be below bore_mm (63), got 100"),
        ("steering.valve.dead_band_v", 7.0, "must be below 6, got 7.0"),
        ("steering.valve.time_constant_s", 1e9, "must be at most 10, got 1000000000.0"),
        ("driveline.pedal_dead_band_v", 7.0, "must be below 6, got 7.0"),
        ("path.speed_m_s", 5.5, "path.speed_m_s"),
        ("driveline.full_speed_m_s", 0.1, "path.speed_m_s: must be at most driveline.full_speed_m_s (0.1), got"),
        ("tractor.rear_wheel_width_m", 50.0, "must be at most 2, got 50.0"),
        ("tractor.rear_wheel_width_m", 1.5, "must be below track_m (1), otherwise the wheels overlap; got 1.5"),
        ("tractor.track_m", 0.01, "must be at least 0.3, got 0.01"),
        ("tractor.axle_pivot_limit_deg", 1000.0, "must be at most 45, got 1000.0"),
        ("tractor.hitch_behind_m", 1e9, "must be at most 10, got 1000000000.0"),
        ("tractor.antenna_height_m", 1e9, "must be at most 20, got 1000000000.0"),
        ("tractor.wheelbase_m", 0.05, "must be at least 0.5, got 0.05"),
        ("duration_s", 1e-300, "must be at least 0.001, got 1e-300"),
    ],
)
def test_error_for_an_implausible_value_names_key_value_and_limit(key, value, said):
    text = refused(**{key: value})
    assert said in text
    assert key in text or "path." in said


def test_soil_that_rebounds_within_a_time_step_is_rejected():
    soil = {"plant__tyre__kind": "ruts"}
    said = refused(**soil, plant__tyre__rebound_mpa_m=2e4)
    assert "plant.tyre.rebound_mpa_m: must be from 1 to 10000 MPa/m" in said
    assert load_scenario("straight_line", {"plant.tyre.kind": "ruts", "plant.tyre.rebound_mpa_m": 1e4})


def test_bend_too_sharp_for_the_tyre_grip_is_rejected():
    text = refused("circle", path__radius_m=3.0, path__speed_m_s=5.0)
    assert "path.speed_m_s: 5 m/s in the sharpest bend (0.333 1/m) needs a lateral acceleration of 8.3 m/s2" in text
    assert load_scenario("circle", {"path.radius_m": 4.0, "path.speed_m_s": 5.0})


@pytest.mark.parametrize(
    ("window", "said"),
    [
        ({"start_s": 5.01, "end_s": 5.02}, "fault[0]: the window 5.01 to 5.02 s contains no tick of 0.05 s"),
        (
            {"start_s": 10.0},
            "fault[0].start_s: 10 s is not before the end of the run (10 s), so the fault has no effect",
        ),
        ({"start_s": 9.95}, None),
        ({"start_s": 5.01, "end_s": 5.06}, None),
    ],
)
def test_fault_outside_the_duration_of_the_run_is_reported(window, said):
    scenario = load_scenario("circle", {"duration_s": 10.0, "fault": [{"kind": "gnss_loss", **window}]})
    assert [line.startswith(said) for line in hints(scenario)] == ([True] if said else [])
    short = scenario.changed({"plant.kind": "bicycle"})
    assert bool(run(short).column("faults_active").any()) == (said is None)


@pytest.mark.parametrize(
    ("kind", "sensor"),
    [
        ("gyro_bias", "gyro"),
        ("wheel_speed_stuck", "wheel_speed"),
        ("imu_roll_stuck", "imu"),
        ("heading_bias", "gnss.dual_antenna"),
    ],
)
def test_fault_of_an_absent_sensor_is_reported(kind, sensor):
    faulty = load_scenario("circle", {"fault": [{"kind": kind, "start_s": 1.0}]})
    (line,) = hints(faulty)
    assert line.startswith(f"fault[0]: {kind} has no effect")
    assert f"sensors.{sensor}.enabled = true" in line
    assert hints(faulty.changed({f"sensors.{sensor}.enabled": True})) == []


@pytest.mark.parametrize(("latency_s", "told"), [(1.0, True), (0.5, False)])
def test_hint_reports_fix_latency_above_the_limit_of_the_supervisor(latency_s, told):
    late = {"supervisor.enabled": True, "sensors.gnss.latency_s": latency_s}
    found = hints(load_scenario("figure_eight", late))
    assert [line.startswith("supervisor.coasting_after_s: 0.6 s") for line in found] == ([True] if told else [])


def test_run_command_prints_hints_on_stderr(call):
    fault = ("--set", "fault=[{kind='gnss_loss', start_s=60.0}]", "--set", "plant.kind=bicycle")
    status, _, err = call("run", "circle", "--no-rrd", "--set", "duration_s=1", *fault, "--out", "out")
    late = "circle: fault[0].start_s: 60 s is not before the end of the run (1 s), so the fault has no effect\n"
    assert (status, err) == (0, late)


SEEDS = ("--max-seeds", 2)
LATE = ("--set", "fault=[{kind='gnss_loss', start_s=60.0}]", "--set", "plant.kind=bicycle", "--set", "duration_s=1")


DRIVING = [
    ("compare", "circle", "--guidance", "lqr", "--no-rrd", *LATE),
    ("limit", "circle", "--key", "path.radius_m", "--range", "12:9", "--until", "xte_rms > 9", *SEEDS, *LATE),
    ("tune", "circle", "--guidance", "stanley", "--budget", 8, "--seeds", 1, *LATE),
    ("sweep", "late.toml", "--jobs", 1),
    ("link", "circle", "--wait", 0.1, "--no-rrd", *LATE),
]


@pytest.mark.parametrize("command", [each for each in DRIVING if is_there(each[0])], ids=lambda command: command[0])
def test_every_simulating_command_prints_each_hint_once(call, undrawn, command, tmp_path):
    common = '"plant.kind" = "bicycle"\nduration_s = 1\nfault = [{ kind = "gnss_loss", start_s = 60 }]'
    (tmp_path / "late.toml").write_text(f'base = "circle"\n[set]\n{common}\n[axes]\n"path.radius_m" = [9, 12]\n')
    _, _, err = call(*command, "--out", "out")
    told = [line for line in err.splitlines() if "fault[0].start_s: 60 s is not before the end of the run" in line]
    assert told
    assert len(set(told)) == len(told)
    assert command[0] == "tune" or len(told) == 1
    if command[0] in ("link", "sweep"):
        _, _, err = call(*command, "--out", "quiet", "-q")
        assert "fault[0].start_s" not in err


def test_run_from_python_issues_hints_as_warnings():
    fault = {"fault": [{"kind": "gnss_loss", "start_s": 60.0}], "plant.kind": "bicycle", "duration_s": 1.0}
    with pytest.warns(ScenarioWarning, match=r"circle: fault\[0\]\.start_s: 60 s is not before the end"):
        agrobot_mj.run(load_scenario("circle", fault))


def test_run_with_an_unresponsive_pedal_ends_as_stuck():
    plant = SimpleNamespace(trouble=lambda: None)
    still = SimpleNamespace(x=0.0, y=0.0, pedal=0.0)
    watch = Watch(plant)
    assert {watch.trouble(still, 0.0, asked=0.3) for _ in range(300)} == {None, "stuck"}
    watch = Watch(plant)
    assert {watch.trouble(still, 0.0, asked=0.01) for _ in range(300)} == {None}
    dead = {"duration_s": 20, "driveline.pedal_rate_per_v_s": 1e-9, "plant.kind": "bicycle"}
    log = run(load_scenario("straight_line", {**dead, "supervisor.enabled": False}))
    assert log.outcome == "stuck"
    log = run(load_scenario("straight_line", dead))
    assert log.outcome == "stopped"
    assert log.metrics["stop_reason"].endswith("off the command")


# --- what takes too long ------------------------------------------------------------------------------------------


def corners(n, seed=1):
    angles, radii = 2 * np.pi * np.arange(n) / n, np.random.default_rng(seed).uniform(5, 30, n)
    return [[float(r * np.cos(a)), float(r * np.sin(a))] for a, r in zip(angles, radii, strict=True)]


def test_cells_inside_polygon_patches_with_many_corners_are_filled():
    patches = [{"kind": "polygon", "points": corners(1000, seed), "cell_m": 0.03} for seed in range(4)]
    load_scenario("straight_line", {"terrain.half_size_m": 40.0, "terrain.patch": patches})


def test_polygon_tests_of_a_grid_and_of_single_points_agree():
    polygon = PolygonPatch(points=tuple(map(tuple, corners(37))))
    x, y = np.linspace(-31, 31, 83), np.linspace(-31, 31, 71)
    grid, points = polygon.covers(x[None, :], y[:, None]), [[in_polygon(polygon.points, a, b) for a in x] for b in y]
    np.testing.assert_array_equal(grid, points)
    assert 0.2 < grid.mean() < 0.6


def test_too_many_cells_of_overlapping_patches_are_rejected_before_filling():
    patch = {"kind": "rectangle", "length_m": 58.0, "width_m": 58.0, "cell_m": 0.03}
    assert "cells must be filled, above the limit of 2e+08" in refused(**{"terrain.patch": [patch] * 1000})


def test_path_of_a_thousand_laps_is_rejected_before_its_construction(tmp_path):
    ways = 2 * np.pi * np.arange(200) / 200
    rows = [f"{1600 * np.cos(a)},{1600 * np.sin(a)}" for a in ways]
    (tmp_path / "loop.csv").write_text("\n".join(["x_m,y_m", *rows]))
    path = '[path]\nkind = "waypoints"\nfile = "loop.csv"\nclosed = true\nlaps = 1000\n[terrain]\nhalf_size_m = 2000\n'
    (tmp_path / "mine.toml").write_text(path)
    assert "km long, more than" in refused(tmp_path / "mine.toml")
