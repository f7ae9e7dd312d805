"""The training example: a few short episodes on the bicycle, compared with the PD law."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="needs gymnasium; pip install agrobot-mj[gym]")
ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(("options", "weights"), [((), 7), (("--speed",), 9)], ids=["steering", "speed"])
def test_trainer_improves_the_policy_compares_and_saves_it(tmp_path, options, weights):
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    size = ["--generations", "3", "--population", "8", "--duration", "8", "--judge-duration", "3", "--workers", "1"]
    command = [sys.executable, str(ROOT / "examples" / "train_figure_eight.py"), "--plant", "bicycle", *size, *options]
    done = subprocess.run(
        [*command, "--out", "policy.npz"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    medians = [float(value) for value in re.findall(r"median +([\d.-]+)", done.stdout)]
    assert len(medians) == 3
    assert medians[-1] > medians[0]
    assert re.search(r"^learnt +lateral rms +[\d.]+ cm .*completed$", done.stdout, re.M)
    assert re.search(r"^PD +lateral rms +[\d.]+ cm .*completed$", done.stdout, re.M)
    assert np.load(tmp_path / "policy.npz")["theta"].shape == (weights,)
