"""Files of a run: `signals.parquet`, `metrics.json`, `scenario.toml`; each appears complete or not at all."""

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
def atomic(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; renamed to `path` if the block succeeds, deleted if it raises."""
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
    """Write `content` as indented JSON."""
    with atomic(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def write_log(log: Log, folder: Path) -> None:
    """Write the three files of a run into `folder`, which is created if missing."""
    with atomic(folder / "signals.parquet") as temporary:
        pq.write_table(log.signals, temporary, compression="zstd")
    write_json(folder / "metrics.json", log.metrics)
    with atomic(folder / "scenario.toml") as temporary:
        temporary.write_text(log.scenario.to_toml(), encoding="utf-8")
