"""Files of a run: `signals.parquet`, `metrics.json`, `scenario.toml`; each appears whole or not at all."""

import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from agrobot_mj.simulation.log import Log


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its name when the block ends well and vanishes when it does not."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: Path, content: Any) -> None:
    """`content` as indented JSON."""
    with whole(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def write_log(log: Log, folder: Path) -> None:
    """The three files of a run into `folder`, which is made if need be."""
    with whole(folder / "signals.parquet") as temporary:
        pq.write_table(log.signals, temporary, compression="zstd")
    write_json(folder / "metrics.json", log.metrics)
    with whole(folder / "scenario.toml") as temporary:
        temporary.write_text(log.scenario.to_toml(), encoding="utf-8")
