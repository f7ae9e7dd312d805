"""Unmodified controllers of other projects steer the tractor in a separate environment (`make third-party`)."""

import json
import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples" / "third_party"
PYTHON = Path(os.environ.get("AGROBOT_THIRD_PARTY_PYTHON", ROOT / ".venv-third-party" / "bin" / "python"))
pytestmark = pytest.mark.skipif(not PYTHON.exists(), reason="not here: `make third-party` makes .venv-third-party")


def called(folder, *arguments):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [PYTHON, *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("law", ["stanley", "pure_pursuit"])
def test_avlite_controller_steers_as_a_plugin(tmp_path, law):
    keys = ("guidance.kind=avlite", f"guidance.law={law}", "guidance.gain_per_s=0.5", "guidance.ahead_m=3")
    sets = [part for key in keys for part in ("--set", key)]
    plugin = ("--plugin", EXAMPLES / "avlite_law.py")
    called(tmp_path, "-m", "agrobot_mj", "run", "straight_line", *plugin, *sets, "--no-rrd", "--out", "run")
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["outcome"] == "completed"
    assert metrics["xte_abs_p95"] < 0.10
    assert f'law = "{law}"' in (tmp_path / "run" / "scenario.toml").read_text()


def test_rox_control_library_steers_a_stepped_simulation(tmp_path):
    metrics = json.loads(called(tmp_path, EXAMPLES / "rox_drive.py", "straight_line", "--set", "duration_s=40"))
    assert metrics["outcome"] == "completed"
    assert metrics["xte_abs_p95"] < 0.10
    aside = ("--set", "path.kind=circle", "--set", "path.radius_m=12", "--set", "duration_s=40")
    assert json.loads(called(tmp_path, EXAMPLES / "rox_drive.py", "straight_line", *aside))["xte_rms"] < 0.5


def test_third_party_code_is_unmodified(tmp_path):
    """Versions and files are those installed by pip."""
    code = (
        "from importlib.metadata import distribution as d; import base64, hashlib\n"
        "for name in ('avlite', 'rox-control'):\n"
        "    for file in d(name).files:\n"
        "        if file.hash and file.suffix == '.py':\n"
        "            digest = hashlib.sha256(file.locate().read_bytes()).digest()\n"
        "            assert base64.urlsafe_b64encode(digest).rstrip(b'=').decode() == file.hash.value, file\n"
        "    print(d(name).version)"
    )
    assert called(tmp_path, "-c", code).split() == ["0.6.6", "0.4.0"]
