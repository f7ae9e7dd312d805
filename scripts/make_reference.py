"""docs/columns.md: the reference of columns and metrics, as the tables of the code have it."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from agrobot_mj.control import Controller, Guidance
from agrobot_mj.control.base import YAW_COLUMNS
from agrobot_mj.control.supervisor import Supervisor
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import Column
from agrobot_mj.core.spec import Spec, every
from agrobot_mj.estimation import Estimator
from agrobot_mj.metrics import METRICS
from agrobot_mj.plants.mujoco.implement import COLUMNS as IMPLEMENT_COLUMNS
from agrobot_mj.sensors import Sensors
from agrobot_mj.simulation.columns import SIGNALS, WHEEL_SIGNALS

PAGE = Path(__file__).parent.parent / "docs" / "columns.md"
HEAD = """# Columns of signals.parquet

One row per tick of 0.05 s, float64, SI units, angles in radians; a value that does not exist in a tick is null. Each
field of the file carries its `unit` and `description` as metadata. Frames: ENU; yaw from east, counter-clockwise;
steering, yaw rate and lateral quantities left positive. This page is written by `make reference` from the table of the
code, `agrobot_mj/simulation/columns.py`; stages add columns of their own.
"""


METRICS_HEAD = """## metrics.json

Beside `outcome` and what the run cost; null where a value does not exist. `table.value` is a value inside a table.
Studies have the same names as columns, in the same units.
"""


def reference() -> str:
    """The page as Markdown."""
    own = {column.name for column in YAW_COLUMNS}
    parts = [HEAD, _section("Every log", (signal.column for signal in SIGNALS))]
    parts.append(_section("Plants with wheels", WHEEL_SIGNALS))
    parts.append(_section("MuJoCo plant with an implement", IMPLEMENT_COLUMNS))
    parts.append(_section("Supervisor", Supervisor().columns))
    for title, union in (("Guidance", Guidance), ("Yaw controller", Controller), ("Estimator", Estimator)):
        for spec in every(union):
            part: Any = spec()
            columns = [column for column in part.columns if column.name not in own]
            if columns:
                parts.append(_section(f"{title} `{spec.model_fields['kind'].default}`", columns))
    for name, sensor in Sensors().all.items():
        enabled = _all_on(sensor)
        if enabled.columns:
            parts.append(_section(f"Sensor `{name}`", enabled.columns))
    parts += [METRICS_HEAD, *(_section(f"Metric `{metric.kind}`", metric.columns) for metric in METRICS)]
    return "\n".join(parts)


def _all_on(part: Any) -> Any:
    """A sensor with itself and all its parts enabled."""
    inner = {name: _all_on(value) for name, value in part if isinstance(value, Spec)}
    return part.model_copy(update=inner | ({"enabled": True} if "enabled" in type(part).model_fields else {}))


def _section(title: str, columns: Iterable[Column]) -> str:
    rows = ((f"`{column.name}`", column.unit, column.description) for column in columns)
    return f"## {title}\n\n{markdown_table(('column', 'unit', 'what'), rows)}\n"


if __name__ == "__main__":
    PAGE.write_text(reference(), encoding="utf-8")
    print(PAGE)
