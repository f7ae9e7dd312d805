"""Files are written completely or not at all."""

import json
import stat

import pyarrow.parquet as pq
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.simulation.results import MARK, atomic, write_json
from agrobot_mj.simulation.storage import write_log


def test_atomic_write_creates_the_file_when_its_block_ends(tmp_path):
    target = tmp_path / "new" / "deep" / "a.txt"
    with atomic(target) as temporary:
        temporary.write_text("half")
        assert not target.exists()
        assert temporary.parent == target.parent  # the same file system: the rename is atomic
    assert target.read_text() == "half"
    assert [path.name for path in target.parent.iterdir()] == ["a.txt"]
    assert stat.S_IMODE(target.stat().st_mode) == 0o644


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_failed_atomic_write_leaves_no_file(tmp_path, error):
    def broken():
        with atomic(tmp_path / "a.txt") as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(error):
        broken()
    assert list(tmp_path.iterdir()) == []


def test_old_file_is_kept_until_the_new_file_is_complete(tmp_path):
    target = tmp_path / "a.json"
    write_json(target, {"old": 1})
    with pytest.raises(ValueError, match="JSON"):
        write_json(target, {"new": float("nan")})
    assert json.loads(target.read_text()) == {"old": 1}
    write_json(target, {"new": [1.5, None]})
    assert json.loads(target.read_text()) == {"new": [1.5, None]}
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_log_is_written_to_three_files(tmp_path):
    log = run(load_scenario("straight_line", {"duration_s": 1.0, "plant.kind": "bicycle", "controller.kind": "pd"}))
    write_log(log, tmp_path / "run")
    names = {"signals.parquet", "metrics.json", "scenario.toml"}
    assert {path.name for path in (tmp_path / "run").iterdir()} == {*names, MARK}
    table = pq.read_table(tmp_path / "run" / "signals.parquet")
    assert table.equals(log.signals)
    assert table["q"].null_count == table.num_rows  # no network: null, not NaN
    assert json.loads((tmp_path / "run" / "metrics.json").read_text()) == log.metrics
    assert load_scenario(tmp_path / "run" / "scenario.toml") == log.scenario


def test_metrics_of_any_run_are_valid_json(tmp_path):
    """Cases include a run of a single tick."""
    for plant in ("bicycle", "mujoco"):
        log = run(load_scenario("straight_line", {"duration_s": 0.05, "plant.kind": plant}))
        write_log(log, tmp_path)
        text = (tmp_path / "metrics.json").read_text()
        json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in metrics.json"))
        assert json.loads(text)["lateral_mse"] is None  # too few ticks to judge
