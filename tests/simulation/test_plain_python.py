"""Compiled kernels give the same run as plain Python, for every ground, load and control component."""

import json
from pathlib import Path

import numpy as np
import pytest
from processes import bare

ROOT = Path(__file__).parents[2]
RUNS = """
import json
import numba
from agrobot_mj import load_scenario, run

CHANGES = {"duration_s": 0.15, "plant.settle_s": 0}
WORN = {"steering.valve.supply_pressure_bar": 90, "steering.linkage.backlash_deg": 2}
WINDY = [{"kind": "side_force", "start_s": 0.0}, {"kind": "drawbar", "start_s": 0.0}]
SENSORS = {"sensors.gyro.enabled": True, "sensors.wheel_speed.enabled": True}
CASES = {
    "ruts": {},  # soil that sinks and remembers
    "plough": {},  # a tool in the ground
    "seeder_contour": {},  # an implement on tyres of its own
    "figure_eight_rough": {"fault": WINDY} | WORN,  # an envelope over rough ground, loads, play, an orifice
    "split_friction": {"plant.tyre.kind": "linear"},  # patches
    "figure_eight": {"guidance.kind": "lqr", "estimator.kind": "ekf_full"} | SENSORS,
    "side_slope": {"guidance.kind": "stanley", "estimator.kind": "ekf_bias"},
    "circle": {"plant.kind": "bicycle", "steering.linkage.backlash_deg": 2},
}
answers = {}
for name, more in CASES.items():
    changes = {key: value for key, value in (CHANGES | more).items()}
    if more.get("plant.kind") == "bicycle":
        del changes["plant.settle_s"]
    log = run(load_scenario(name, changes))
    answers[name] = {column: log.column(column).tolist() for column in log.signals.column_names}
"""


def test_every_compiled_kernel_equals_plain_python():
    here = {}
    exec(RUNS, here)
    script = f"{RUNS}\nprint(json.dumps([numba.config.DISABLE_JIT, answers]))"
    done = bare(ROOT, "-c", script)
    assert done.returncode == 0, done.stderr
    disabled, there = json.loads(done.stdout)
    assert disabled
    for name, columns in here["answers"].items():
        for column, values in columns.items():
            found = np.array(there[name][column], dtype=float)
            wanted = pytest.approx(np.array(values, dtype=float), rel=1e-6, abs=1e-7, nan_ok=True)
            assert found == wanted, (name, column)
