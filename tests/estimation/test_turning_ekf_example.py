"""examples/turning_ekf.py: its derivatives, and a run with the example as a plugin."""

import json
from pathlib import Path

import numpy as np
import pytest
from processes import command
from turning_ekf import TurningEkf

ROOT = Path(__file__).parents[2]
ESTIMATOR, DT = TurningEkf(), 0.05
MEANS = [np.array([1.0, -2.0, yaw, v, rate]) for yaw in (0.3, -2.0) for v in (1.2, -0.8) for rate in (0.0, 0.4)]


def derivative(function, mean, h=1e-6):
    """Return the derivative by central differences, with values along the first axis."""
    return np.transpose([(function(mean + h * e) - function(mean - h * e)) / (2 * h) for e in np.eye(5)])


@pytest.mark.parametrize("mean", MEANS)
def test_derivatives_equal_finite_differences(mean):
    moved = derivative(lambda x: ESTIMATOR._moved(x, DT), mean)
    assert np.allclose(ESTIMATOR._transition(mean, DT), moved, atol=1e-8)
    assert np.allclose(ESTIMATOR._slopes(mean), derivative(ESTIMATOR._expected, mean), atol=1e-8)


def test_example_estimator_drives_a_circle_as_a_plugin(tmp_path):
    keys = ("estimator.kind=turning_ekf", "guidance.kind=lqr", "plant.kind=bicycle", "duration_s=20")
    plugin = ("--plugin", ROOT / "examples" / "turning_ekf.py", "--no-rrd", "--out", tmp_path / "run")
    done = command(tmp_path, "run", "circle", *plugin, *(x for key in keys for x in ("--set", key)))
    assert done.returncode == 0, done.stderr
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text("utf-8"))
    assert metrics["xte_estimator_rms"] < 0.02
    assert 0.2 < metrics["position_nees"] < 8.0
