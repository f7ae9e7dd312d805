"""The table of public logs has one permanent row per log and release. Files are compared by their intervals."""

from types import SimpleNamespace

import log_table
import pytest

from agrobot_mj.extensions.logs.quantities import Quantity

LOGS = '[[log]]\nname = "mine"\nfiles = ["field.csv"]\nset = ["tractor.wheelbase_m=2.4"]\n'


@pytest.fixture
def logs(tmp_path):
    (tmp_path / "logs.toml").write_text(LOGS)
    (tmp_path / "field.csv").write_text("time_s,speed_km_h\n0,1\n1,1\n")
    return tmp_path / "logs.toml"


def test_table_row_of_an_unusable_log_contains_the_reason(logs, capsys):
    assert log_table.main([str(logs)]) == 0
    (row,) = log_table.rows_of(logs.with_suffix(".md").read_text())
    assert row[1] == "mine"
    assert row[-2] == "tractor.wheelbase_m=2.4"
    assert "field.csv" in row[-1]
    assert len(row) == len(log_table.HEAD)
    assert capsys.readouterr().out == logs.with_suffix(".md").read_text()


def test_table_for_a_new_release_keeps_rows_of_earlier_releases(logs, monkeypatch):
    monkeypatch.setattr(log_table, "cells", lambda log, folder: ("60", "1.0 / 2.0", "0.1 / 0.2", "90%", "-", "-"))
    log_table.main([str(logs)])
    before = log_table.rows_of(logs.with_suffix(".md").read_text())
    monkeypatch.setattr(log_table, "cells", lambda log, folder: ("60", "9.0 / 9.0", "9 / 9", "9%", "-", "-"))
    log_table.main([str(logs)])
    assert log_table.rows_of(logs.with_suffix(".md").read_text()) == before
    monkeypatch.setattr(log_table, "__version__", "99.0")
    log_table.main([str(logs)])
    after = log_table.rows_of(logs.with_suffix(".md").read_text())
    assert after[:-1] == before
    assert after[-1][0] == "99.0"
    assert after[-1][3] == "9.0 / 9.0"


def test_log_table_script_without_a_file_prints_its_usage(capsys):
    assert log_table.main(["none.toml"]) == 2
    assert "usage" in capsys.readouterr().err


def test_values_from_two_log_files_are_compared_in_standard_errors(logs, capsys, monkeypatch):
    found = iter([Quantity(10.0, 7.0, 13.0, True), Quantity(15.0, 11.0, 19.0, False)])
    monkeypatch.setattr(log_table, "calibrate", lambda *_: SimpleNamespace(found={"steer.offset": next(found)}))
    columns = "time_s,steer_angle_deg,speed_km_h,latitude,longitude,fix_quality"
    logs.with_name("field.csv").write_text(f"{columns}\n0,0,1,0,0,4\n1,0,1,0,0,4\n")
    logs.write_text(LOGS.replace('"field.csv"', '"field.csv", "field.csv"'))
    assert log_table.main(["--files", str(logs)]) == 0
    *_, row = capsys.readouterr().out.strip().splitlines()
    assert row == "| `steer.offset` | 10 [7, 13] | (15 [11, 19]) | 2.0 |"
    assert not logs.with_suffix(".md").exists()
