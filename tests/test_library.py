"""Library scenarios: each ends as stated in its file, without physics warnings, and has a valid recording."""

import subprocess
import sys

import pytest

from agrobot_mj.recording import Recording
from agrobot_mj.scenario.loading import load_scenario, scenario_files
from agrobot_mj.simulation.run import run

BRIEFLY_S = 4.0


def check(log):
    assert log.as_expected, f"{log.outcome} {log.metrics.get('stop_reason', '')}"
    assert log.metrics["physics_warnings"] == 0


def test_library_has_at_least_twenty_scenarios():
    assert len(scenario_files()) >= 20


@pytest.mark.parametrize("name", scenario_files())
def test_every_shipped_scenario_describes_its_purpose(name):
    head = scenario_files()[name].read_text(encoding="utf-8").splitlines()
    assert head[0].startswith("# ")
    assert any(line.startswith("# ") and "Look at: " in line for line in head)
    assert load_scenario(name).title


@pytest.mark.parametrize("name", scenario_files())
def test_shipped_scenario_completes_or_ends_as_expected(name):
    scenario = load_scenario(name)
    if scenario.expected_outcome == "completed":
        scenario = scenario.changed({"duration_s": BRIEFLY_S})
    check(run(scenario))


@pytest.mark.parametrize("name", ["reverse_into_row", pytest.param("headland_k_turn", marks=pytest.mark.slow)])
def test_tractor_stops_at_each_cusp_and_continues(name):
    """The command may fall faster than the speed of the tractor, which is not an overspeed."""
    check(run(load_scenario(name)))


@pytest.mark.slow
@pytest.mark.parametrize("name", scenario_files())
def test_shipped_scenario_ends_as_expected_with_a_valid_recording(name, tmp_path):
    file = tmp_path / "run.rrd"
    check(run(load_scenario(name), (Recording(file),)))
    verified = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(file)], capture_output=True, check=False
    )
    assert verified.returncode == 0, verified.stderr
    assert file.stat().st_size < 12e6 * max(1.0, load_scenario(name).ticks / 4800)
