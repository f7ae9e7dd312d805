"""A short attack with hostile inputs finds nothing; `make attack` is the long one."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("seed", [3])
def test_hostile_inputs_give_no_traceback_and_no_silence(tmp_path, seed):
    command = [sys.executable, str(ROOT / "scripts" / "attack.py"), "--seed", str(seed), "--inputs", "60"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [*command, "--only", "overrides,toml,files,nan"],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert done.stdout.count("0 findings") == 4
