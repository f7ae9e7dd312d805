"""What `make install` says while pip works: which package of how many, as soon as pip names it."""

import subprocess
import sys
from pathlib import Path

from pip_progress import packages, progress

SCRIPT = Path(__file__).parents[1] / "scripts" / "pip_progress.py"
LOCK = """\
click==8.5.1 \\
    --hash=sha256:00==
colorama==0.4.6 ; os_name == 'nt' \\
    # via==x
rich==15.0.0
mujoco==3.1
"""
PIP = """\
Ignoring colorama: markers 'os_name == "nt"' don't match your environment
Requirement already satisfied: click==8.5.1 in ./lib (from -r requirements.lock (line 1))
Collecting rich==15.0.0 (from -r requirements.lock (line 3))
  Downloading rich-15.0.0-py3-none-any.whl.metadata (18 kB)
Collecting mujoco==3.1 (from -r requirements.lock (line 4))
  Using cached mujoco-3.1-py3-none-any.whl.metadata (18 kB)
Using cached rich-15.0.0-py3-none-any.whl (310 kB)
Downloading mujoco-3.1-cp311.whl (17.5 MB)
Installing collected packages: rich, mujoco
Successfully installed mujoco rich
"""


def test_each_package_is_counted_to_the_number_of_the_lock():
    assert packages(LOCK) == 4
    assert list(progress(PIP.splitlines(keepends=True), packages(LOCK))) == [
        "      2 of 3  rich==15.0.0",
        "      3 of 3  mujoco==3.1",
        "      2 of 3  Using cached rich-15.0.0-py3-none-any.whl (310 kB)",
        "      3 of 3  Downloading mujoco-3.1-cp311.whl (17.5 MB)",
        "    unpacking them",
    ]
    assert next(progress(["Collecting a\n"], 0)) == "      1  a"


def test_a_line_is_told_at_once_and_a_failure_by_the_status():
    with subprocess.Popen(
        [sys.executable, SCRIPT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        process.stdin.write("Collecting a\n")
        process.stdin.flush()
        assert process.stdout.readline() == "      1  a\n"  # before anything else comes
        process.stdin.write("FAILED\n")
        process.stdin.close()
        assert process.wait(timeout=300) == 1
