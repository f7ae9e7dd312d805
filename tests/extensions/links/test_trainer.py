"""The training example: a few short episodes on the bicycle, compared with the PD law."""

import re
from pathlib import Path

import numpy as np
import pytest
from processes import script

pytest.importorskip("gymnasium", reason="needs gymnasium; pip install agrobot-mj[gym]")
ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(("options", "weights"), [((), 7), (("--speed",), 9)], ids=["steering", "speed"])
def test_trainer_improves_saves_and_compares_the_policy(tmp_path, options, weights):
    size = ["--generations", "3", "--population", "8", "--duration", "8", "--judge-duration", "3", "--workers", "1"]
    options = ("--plant", "bicycle", *size, *options, "--out", "policy.npz")
    done = script(tmp_path, ROOT / "examples" / "train_figure_eight.py", *options)
    assert done.returncode == 0, done.stderr
    medians = [float(value) for value in re.findall(r"median +([\d.-]+)", done.stdout)]
    assert len(medians) == 3
    assert medians[-1] > medians[0]
    assert re.search(r"^learnt +lateral rms +[\d.]+ cm .*completed$", done.stdout, re.M)
    assert re.search(r"^PD +lateral rms +[\d.]+ cm .*completed$", done.stdout, re.M)
    assert np.load(tmp_path / "policy.npz")["theta"].shape == (weights,)
