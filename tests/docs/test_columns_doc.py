"""docs/reference/columns.md equals the table of columns, which describes each column."""

from pathlib import Path

import pyarrow.parquet as pq
import pytest
from make_reference import reference
from removed import needs_all

from agrobot_mj import load_scenario, run
from agrobot_mj.simulation.columns import SIGNALS, WHEEL_SIGNALS
from agrobot_mj.simulation.storage import write_log

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "columns.md"
UNITS = {"-", "s", "m", "m2", "1/m", "1/(m s)", "m/s", "m/s2", "rad", "rad2", "rad/s", "N", "V", "Pa", "m3/s", "N m"}


@needs_all
def test_columns_page_equals_the_generated_reference():
    assert PAGE.read_text(encoding="utf-8") == reference(), "run `make reference`"


def test_every_column_has_a_unit_and_a_description():
    columns = [signal.column for signal in SIGNALS] + list(WHEEL_SIGNALS)
    assert len({column.name for column in columns}) == len(columns)
    for column in columns:
        assert column.unit in UNITS, column
        assert len(column.description) > 8, column
        assert not column.description.endswith("."), column


@pytest.mark.parametrize("plant", ["bicycle", "mujoco"])
def test_signals_file_contains_units_and_descriptions(tmp_path, plant):
    unsettled = {"plant.settle_s": 0.0} if plant == "mujoco" else {}
    write_log(run(load_scenario("circle", {"plant.kind": plant, "duration_s": 0.2, **unsettled})), tmp_path)
    schema = pq.read_schema(tmp_path / "signals.parquet")
    for field in schema:
        assert field.metadata[b"unit"], field
        assert field.metadata[b"description"], field
    assert schema.field("yaw_rate").metadata[b"unit"] == b"rad/s"
    assert schema.field("c2_1").metadata[b"unit"] == b"rad/s2"
