"""`--json` of the data sheet: one document on stdout for any exit status, with the numbers of the text output."""

from pathlib import Path

import pytest
from json_documents import COMMON, documented

from agrobot_mj.extensions.bench import datasheet
from agrobot_mj.extensions.bench.datasheet import Measured


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_json_data_sheet_has_the_values_of_the_text_output(asked, call, monkeypatch):
    sheet = [Measured("mass", 13912.123456, "kg"), Measured("slope that it climbs", float("nan"), "deg")]
    monkeypatch.setattr(datasheet, "data_sheet", lambda name: iter(sheet))
    found, err = asked("machine", "row_crop")
    assert found["sheet"][0] == {"name": "mass", "value": 13912.1, "unit": "kg"}
    assert found["sheet"][1]["value"] is None
    assert documented("machine") == set(found) - COMMON
    assert err == call("machine", "row_crop")[1]  # as it is measured
    assert " 13910 kg\n" in err


def test_impossible_machine_is_reported_by_its_file_name(asked):
    Path("mine.toml").write_text("[tractor]\nmass_kg = 5000\nwheelbase_m = 2.6\nyaw_inertia_kg_m2 = 100\n")
    found, _ = asked("machine", "mine.toml")
    assert found["exit_status"] == 2
    assert found["error"].startswith("mine.toml: tractor: roll_")
