"""docs/extensions/logs/replay.md: its map is valid, and its options, keys and columns exist."""

import re
import tomllib
from pathlib import Path

import typer.main

from agrobot_mj import load_scenario, run
from agrobot_mj.cli import app
from agrobot_mj.extensions.logs.identify.vehicle import CHOICES
from agrobot_mj.extensions.logs.maps import AGOPENGPS_MAP, LogMap, PositionColumns, ValveColumn, named_columns, read_map
from agrobot_mj.extensions.logs.replay.result import replay

TEXT = (Path(__file__).parents[3] / "docs" / "extensions" / "logs" / "replay.md").read_text(encoding="utf-8")
(MAP,) = re.findall(r"```toml\n(.*?)```", TEXT, re.S)


def test_example_map_of_the_page_is_complete(tmp_path):
    (tmp_path / "map.toml").write_text(MAP, encoding="utf-8")
    found = read_map(tmp_path / "map.toml")
    assert found.position is not None
    assert found.position.accepted == (4,)
    assert set(tomllib.loads(MAP)) == set(LogMap.model_fields) - {"valve"}


def test_map_keys_named_on_the_page_exist():
    for key in ("volts_per_unit", "neutral"):
        assert f"`{key}`" in TEXT
        assert key in ValveColumn.model_fields
    assert set(re.findall(r"`(origin_\w+)`", TEXT)) <= set(PositionColumns.model_fields)


def test_csv_columns_on_the_page_equal_those_of_the_built_in_map():
    table = TEXT.partition("if the columns have these names:")[2].partition("Other columns are ignored")[0]
    assert set(re.findall(r"`(\w+)`", table)) == set(named_columns(AGOPENGPS_MAP))


def test_every_option_named_on_the_page_exists():
    commands = typer.main.get_command(app).commands
    known = {o for p in commands["twin"].params for o in p.opts}
    assert set(re.findall(r"--[a-z][a-z-]*", TEXT)) <= known


def test_every_metric_explained_on_the_page_is_a_replay_metric():
    log = run(load_scenario("circle", {"plant.kind": "bicycle", "duration_s": 12, "sensors.gyro.enabled": True}))
    found = replay(log.signals, None, log.scenario).metrics
    table = TEXT.partition("`replay.json` contains:")[2].partition("`replay.parquet`")[0]
    named = [name.rpartition(".")[2] for name in re.findall(r"`([\w.]+)`", table)]
    assert {"rms_without_bias", "windows_rms", "lag_s", "at_the_end"} <= set(named)
    assert set(named) <= set(found["yaw_rate"]) | set(found["position"])


def test_every_fit_parameter_named_on_the_page_exists():
    assert "lag" in CHOICES
