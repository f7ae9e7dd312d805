"""Export of a finished run as an MCAP file of ROS 2 messages for `ros2 bag` and Foxglove. ROS is not required.

The file contains the messages of a live tractor with their time stamps, /tf and /tf_static for viewers, and the
commands received on /cmd_vel.
"""

import json
from collections.abc import Iterator
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from agrobot_mj.core.errors import ScenarioError, import_extra
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.core.table_columns import check_time, read_columns
from agrobot_mj.core.version import __version__
from agrobot_mj.extensions.links.ros2.content import (
    AGAIN_TICKS,
    Content,
    TickSample,
    fixed_frames,
    frames,
    messages,
    nanoseconds,
    path,
    request,
    samples_of,
    site_of,
    stamp,
)
from agrobot_mj.extensions.links.ros2.definitions import RECORDED, full_definition, full_name
from agrobot_mj.extensions.links.running import gyro_heading
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.results import atomic, results

FILE = "run.mcap"
LARGEST = 1e9  # Upper limit of the absolute value of any signal [SI units]


def export_run(folder: Path, out: Path | None = None) -> tuple[Path, int]:
    """Write the run in `folder` to an MCAP file in `out`, by default `folder`. Return its path and message count."""
    for name in ("scenario.toml", "signals.parquet"):
        if not (folder / name).is_file():
            raise ScenarioError(f"{folder}: the folder has no {name}; specify the folder of a run")
    with results(out or folder, [FILE]) as place:
        scenario, signals = load_scenario(folder / "scenario.toml"), _signals(folder / "signals.parquet")
        return place / FILE, write_mcap(scenario, signals, place / FILE, _waiting_time(folder / "metrics.json"))


def _waiting_time(file: Path) -> float:
    """Return the time for which a ROS node waited for a program before the run [s], or 0 for a run without a node."""
    try:
        waited = json.loads(file.read_text(encoding="utf-8"))["ros2"]["waited_s"]
    except (OSError, ValueError, KeyError, TypeError):
        return 0.0
    return float(waited) if isinstance(waited, int | float) and 0.0 <= waited < LARGEST else 0.0


def _signals(file: Path) -> pa.Table:
    try:
        schema = pq.read_schema(file.absolute())
    except (pa.ArrowException, OSError, ValueError):
        raise ScenarioError(f"{file}: the file is not the Parquet file of a run; specify the folder of a run") from None
    there = {field.name for field in schema if not pa.types.is_null(field.type)}  # null if the run ended at once
    columns = read_columns(file, ["t", *(name for name in TickSample._fields if name in there)])
    check_time(file.name, "t", columns["t"])
    for name, values in columns.items():
        if (bad := np.flatnonzero(np.abs(values) >= LARGEST)).size:
            raise ScenarioError(
                f"{file.name}: {name!r} is {values[bad[0]]:g} in row {bad[0] + 1}, which is not plausible; check the "
                "file"
            )
    return pa.table(columns)


def write_mcap(scenario: Scenario, signals: pa.Table, file: Path, waited_s: float = 0.0) -> int:
    """Write a run to an MCAP file. Return the number of messages. Raises `ScenarioError` without the extra `mcap`."""
    library: Any = import_extra("mcap_ros2.writer", "mcap", "export --mcap")
    with atomic(file) as temporary:
        writer = library.Writer(str(temporary))
        schemas = {
            topic: writer.register_msgdef(full_name(kind), full_definition(kind)) for topic, kind in RECORDED.items()
        }
        about = {
            "version": __version__,
            "scenario": scenario.name,
            "identity": str(scenario.identity),
            "seed": str(scenario.seed),
        }
        writer.add_metadata("agrobot_mj", about)
        count = 0
        for topic, t, content in messages_of(scenario, signals, waited_s):
            at = nanoseconds(t)
            writer.write_message(topic, schemas[topic], content, log_time=at, publish_time=at, sequence=count)
            count += 1
        writer.finish()
    return count


def messages_of(scenario: Scenario, signals: pa.Table, waited_s: float) -> Iterator[tuple[str, float, Content]]:
    """Yield topic, time [s] and content of each message of a run in chronological order."""
    site, yaw, way = site_of(scenario), nan, path(scenario)
    for k, sample in enumerate(samples_of(signals)):
        t, yaw = sample.t + waited_s, gyro_heading(yaw, sample.gyro, sample.yaw, TICK_S)
        if k % AGAIN_TICKS == 0:
            yield "/path", t, way
            yield "/tf_static", t, fixed_frames(site, stamp(t))
        for topic, content in messages(sample, site, yaw, t):
            yield topic, t, content
        yield "/tf", t, frames(sample, site, stamp(t))
        if sample.cmd_age == 0.0:
            yield "/cmd_vel", t, request(sample)
