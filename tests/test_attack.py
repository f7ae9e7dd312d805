"""A short attack with hostile inputs finds no faults, except planted ones. `make attack` is the long version."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CLASSES = ["overrides", "toml", "sweeps", "files", "parquet", "plugins", "nan", "interrupts", "copies"]
"""Classes of malformed inputs that take about a second each."""
for file in sorted(ROOT.glob("tests/extensions/*/attack_*.py")):
    CLASSES += re.findall(r'"(\w+)": \(', file.read_text("utf-8").rpartition("\nCLASSES = ")[2])


def python(tmp_path, *arguments):
    """Return a completed Python process with the given arguments."""
    return subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("seed", [3])
def test_malformed_inputs_cause_no_traceback_and_no_silent_failure(tmp_path, seed):
    arguments = ["--seed", str(seed), "--inputs", "15", "--only", ",".join(CLASSES)]
    done = python(tmp_path, str(ROOT / "tests" / "attack"), *arguments)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert done.stdout.count(" 0 findings") == len(CLASSES)
    assert list(tmp_path.iterdir()) == []


BROKEN = {
    "raise ZeroDivisionError": "ZeroDivisionError",
    "raise SystemExit(7)": "exit status 7",
    "raise SystemExit(2)": "exit status 2 without a word",
    "print('x' * 20000, file=sys.stderr)": "20001 characters on stderr",
    "open('MUJOCO_LOG.TXT', 'w')": "files outside --out: ['MUJOCO_LOG.TXT']",
    "Path('out').mkdir(); print('no', file=sys.stderr); raise SystemExit(2)": "bad input, but a folder is there",
    "time.sleep(60)": "no end within 1 s",
    "x = b'x' * 1_000_000_000": "took ",
    "os.kill(os.getpid(), 11)": "ended by SIGSEGV",
    "pass": "",
}
JUDGE = """
import json, os, random, sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import judge
judge.MOST_KB = 400_000  # far from what is taken: a busy machine pages out some of it before the peak

def found(line):
    judge.cli.main = lambda: exec(line)
    return judge.judged(lambda chance: judge.call(["run"]), random.Random(1), 1.0 if "sleep" in line else 60.0)

print(json.dumps({line: found(line) for line in json.loads(sys.argv[2])}))
"""


def test_attack_program_detects_known_violations(tmp_path):
    done = python(tmp_path, "-c", JUDGE, str(ROOT / "tests" / "attack"), json.dumps(list(BROKEN)))
    found = json.loads(done.stdout)
    for line, finding in BROKEN.items():
        assert finding in found[line]
    assert found["pass"] == ""
    assert list(tmp_path.iterdir()) == []
