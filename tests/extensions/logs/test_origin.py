"""A result from logs contains the identity of all its inputs."""

import json

import pyarrow.parquet as pq
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.identity import differing, read_identity
from agrobot_mj.extensions.logs.maps import known_map
from agrobot_mj.extensions.logs.origin import log_identity
from agrobot_mj.simulation.storage import write_log

BICYCLE = ("--set", "plant.kind=bicycle")
COMMANDS = {
    "replay.json": ("twin", "log.parquet", "--only", "replay", *BICYCLE, "--from", "3"),
    "calibration.json": ("twin", "log.parquet", "--only", "calibrate", *BICYCLE),
    "twin.json": ("twin", "log.parquet", *BICYCLE),
    "vehicle.json": ("twin", "log.parquet", "--only", "identify", "--fit", "front,rear", "--share", "0.9", *BICYCLE),
    "identified.json": ("twin", "run", "--only", "valve"),
}


@pytest.fixture(scope="module")
def driven():
    keys = {"plant.kind": "bicycle", "sensors.gyro.enabled": True, "duration_s": 52, "controller.kind": "pd"}
    return run(load_scenario("figure_eight", keys))


@pytest.mark.usefixtures("quick_fit")
@pytest.mark.parametrize("file", COMMANDS)
def test_every_log_command_writes_identity_of_logs_scenario_and_code(file, driven, tmp_path, call):
    write_log(driven, tmp_path / "run")

    def identity(*more, rows=1040):
        pq.write_table(driven.signals.slice(0, rows), tmp_path / "log.parquet")
        pq.write_table(driven.signals.slice(0, rows), tmp_path / "run" / "signals.parquet")
        status, _, err = call(*COMMANDS[file], *more, "--out", "found")
        assert status == 0, err
        found = json.loads((tmp_path / "found" / file).read_text())["identity"]
        assert read_identity(found), found
        return found

    first = identity()
    if file == "identified.json":  # the scenario of a run is its own
        assert differing(identity(rows=1000), first) == ["files"]
    else:
        assert set(differing(identity("--set", "tractor.mass_kg=1234", rows=1000), first)) == {"files", "scenario"}


def test_log_identity_depends_on_contents_and_options_but_not_on_names(driven, tmp_path):
    scenario, table = driven.scenario, driven.signals
    first, second = tmp_path / "a.parquet", tmp_path / "b.parquet"
    for path in (first, second):
        pq.write_table(table, path)
    log_map = known_map(table.column_names)
    whole = log_identity(scenario, [first], log_map, start_s=0.0)
    assert log_identity(scenario, [second], log_map, start_s=0.0) == whole
    assert differing(log_identity(scenario, [second], log_map, start_s=1.5), whole) == ["scenario"]
    assert differing(log_identity(scenario, [second], None, start_s=0.0), whole) == ["scenario"]
    assert differing(log_identity(scenario, [first, second], log_map, start_s=0.0), whole) == ["files"]
    in_memory = log_identity(scenario, [table])
    assert log_identity(scenario, [table.replace_schema_metadata({"name": "other"})]) == in_memory
    assert differing(log_identity(scenario, [table.slice(1)]), in_memory) == ["files"]


def test_identity_of_twin_results_includes_the_code_of_log_readers(driven):
    found = read_identity(log_identity(driven.scenario, []))
    assert found.program != driven.scenario.identity.program
    assert found[2:] == (driven.scenario.identity.plugins, found.program, driven.scenario.identity.libraries)
