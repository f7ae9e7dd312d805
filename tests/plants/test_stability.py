"""Stability limits of tyre parameters due to physics and step size: reported before a run, and correct."""

from pathlib import Path

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.spec import every
from agrobot_mj.recording import Recording
from agrobot_mj.simulation.loop import build_plant
from agrobot_mj.simulation.storage import write_log
from agrobot_mj.tyres import Tyre

LINEAR = {"plant.tyre.kind": "linear"}


def limited(**overrides):
    keys = {key.replace("__", "."): value for key, value in overrides.items()}
    with pytest.raises(ScenarioError) as refused:
        build_plant(load_scenario("figure_eight", keys))
    return str(refused.value)


@pytest.mark.parametrize(
    ("key", "value", "more"),
    [
        ("plant.tyre.bristle_damping_s", 1000.0, LINEAR),
        ("tractor.front_tyre_damping_n_s_m", 1e9, LINEAR),
        ("tractor.front_tyre_damping_n_s_m", 1.2e5, {}),
        ("tractor.rear_tyre_damping_n_s_m", 1e9, {}),
        ("tractor.rear_tyre_stiffness_n_m", 1e9, {}),
        ("plant.tyre.relaxation_radii", 1e-6, LINEAR),
    ],
)
def test_numerically_unstable_tyre_parameter_is_rejected_with_its_limit(key, value, more):
    assert f"figure_eight: {key}: must be " in (said := limited(**{key: value}, **more))
    assert f"got {value:g}; otherwise this tractor and tyre would be unstable at physics_dt_s = 0.002" in said


@pytest.mark.parametrize(
    ("key", "below", "above", "shaken"),
    [
        ("tractor.front_tyre_damping_n_s_m", 2.4e4, 3.0e4, "load_fl"),
        ("plant.tyre.bristle_damping_s", 0.25, 0.5, "fx_fl"),
    ],
)
def test_stability_limit_is_where_forces_alternate_between_steps(monkeypatch, key, below, above, shaken):
    def shaking(value):
        log = run(load_scenario("straight_line", {**LINEAR, "duration_s": 2.0, "path.speed_m_s": 0.2, key: value}))
        return float(np.abs(np.diff(log.column(shaken))[5:]).mean())

    assert build_plant(load_scenario("straight_line", {**LINEAR, key: below}))
    limited(**{key: above}, **LINEAR)
    calm = shaking(below)
    monkeypatch.setattr("agrobot_mj.plants.mujoco.build.check_stability", lambda *_: None)
    assert shaking(above) > 20 * calm


@pytest.mark.parametrize("tyre", every(Tyre))
def test_every_tyre_is_far_from_instability_at_the_longest_time_step(tyre):
    overrides = {"plant.tyre.kind": tyre.model_fields["kind"].default, "physics_dt_s": 0.005}
    many = {f"tractor.{axle}_tyre_damping_n_s_m": 5000.0 for axle in ("front", "rear")}
    assert build_plant(load_scenario("figure_eight", overrides | many))


@pytest.mark.parametrize(
    ("key", "value", "limit"),
    [("driveline.front_lead", 1e9, "at most 1.25"), ("plant.tyre.front.lateral.mu", 5e-324, "at least 0.01")],
)
def test_physically_impossible_machine_parameters_are_rejected(key, value, limit):
    assert f"{key}: must be {limit}" in limited(**{key: value})


def test_numerically_unstable_run_ends_as_diverged_and_keeps_its_files(monkeypatch, tmp_path, capfd):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("agrobot_mj.plants.mujoco.build.check_stability", lambda *_: None)
    scenario = load_scenario("figure_eight", {**LINEAR, "plant.tyre.bristle_damping_s": 1e5, "duration_s": 1.0})
    log = run(scenario, (Recording(Path("out/run.rrd")),))
    assert (log.outcome, log.rows.filled) == ("diverged", 1)
    assert "diverged while settling" in log.metrics["stop_reason"]
    write_log(log, Path("out"))
    assert {path.name for path in tmp_path.iterdir()} == {"out"}  # no MUJOCO_LOG.TXT
    assert capfd.readouterr().err == ""
