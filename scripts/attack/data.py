"""Data files: heights, waypoints, and Parquet of earlier runs."""

import atexit
import io
import random
import shutil
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from judge import call
from PIL import Image
from texts import SHORT, sets

from agrobot_mj import load_scenario, run
from agrobot_mj.core.resources import SCENARIOS
from agrobot_mj.simulation.storage import write_log

BITS = (b"nan", b"-", b"1e999", b"\xff", b"", b",", b"\n", b"\x00" * 4)


@cache
def sources() -> dict[str, bytes]:
    """Good files, by name."""
    heights = np.cumsum(np.random.default_rng(1).normal(0, 0.01, (64, 64)), axis=0)
    array, picture = io.BytesIO(), io.BytesIO()
    np.save(array, heights)
    Image.fromarray((heights * 1000 + 30_000).astype(np.uint16)).save(picture, "png")
    texts = {name: (SCENARIOS / name).read_bytes() for name in ("hills.asc", "waypoints.csv")}
    return {**texts, "heights.npy": array.getvalue(), "heights.png": picture.getvalue()}


def bent(chance: random.Random, content: bytes, most: int = 20) -> bytes:
    """Some bytes changed, and perhaps cut short."""
    changed = bytearray(content)
    for _ in range(chance.randint(1, most)):
        at = chance.randrange(len(changed))
        if chance.random() < 0.5:
            changed[at] ^= 1 << chance.randrange(8)
        else:
            changed[at : at + chance.randint(0, 3)] = chance.choice(BITS)
    return bytes(changed[: chance.choice([len(changed), len(changed), chance.randrange(len(changed))])])


def odd_array(chance: random.Random) -> bytes:
    """An array of another kind than heights."""
    kind = chance.choice(["f8", "f4", "i8", "u1", "c16", "U3", "M8[s]", "?", ">f8", "f2"])
    shape = chance.choice([(8, 8), (0,), (1, 1), (4,), (2, 2, 2), (3, 0), (2000, 2)])
    array, out = np.ones(shape, dtype="f8").astype(kind), io.BytesIO()
    if array.size and array.dtype.kind == "f":
        with np.errstate(over="ignore"):
            array.flat[0] = chance.choice([np.nan, np.inf, -1e30, 1e308])
    np.save(out, array)
    return out.getvalue()


def files(chance: random.Random) -> str:
    """Heights or waypoints, bent."""
    name = chance.choice(list(sources()))
    file = Path(f"bent{Path(name).suffix}")
    odd = file.suffix == ".npy" and chance.random() < 0.5
    file.write_bytes(odd_array(chance) if odd else bent(chance, sources()[name]))
    table, kind = ("path", "waypoints") if file.suffix == ".csv" else ("terrain", "heightmap")
    plant = "bicycle" if table == "path" else "mujoco"
    words = [f"{table}.kind={kind}", f"{table}.file={file.name}", f"plant.kind={plant}"]
    more = [] if plant == "bicycle" else ["plant.settle_s=0.1", "plant.settle_limit_s=1", "duration_s=0.2"]
    return call(["run", "straight_line", *SHORT, *sets(*words, *more)])


@cache
def earlier() -> Path:
    """A folder of an earlier run."""
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    log = run(load_scenario("figure_eight", {"duration_s": 20.0, "plant.kind": "bicycle"}))
    write_log(log, folder)
    return folder


def parquet(chance: random.Random) -> str:
    """Signals of an earlier run, bent, for the commands that read them."""
    shutil.copytree(earlier(), "run")
    file = Path("run") / "signals.parquet"
    if chance.random() < 0.3:
        file.write_bytes(bent(chance, file.read_bytes(), 3))
    else:
        table = pq.read_table(file)
        for _ in range(chance.randint(1, 2)):
            table = _odd_table(chance, table)
        pq.write_table(table, file, compression=chance.choice(["zstd", "snappy", "none"]))
    commands = (["identify", "run"], ["identify", "run", "--vehicle", "--out", "out"], ["report", "run", "--quiet"])
    commands = (*commands, ["replay", "run", "--out", "out", "--quiet"], ["export", "run", "--mcap", "--quiet"])
    return call(chance.choice(commands))


def _odd_table(chance: random.Random, table: pa.Table) -> pa.Table:
    """The table with a column, or its rows, changed."""
    names = [
        *("t", "valve_voltage", "steer_measured", "x", "y", "yaw", "speed", "steer"),
        chance.choice(table.column_names),
    ]
    name = chance.choice([name for name in names if name in table.column_names] or table.column_names)
    at, n = table.column_names.index(name), len(table)
    old = table.column(at)  # there may be two of the name
    values = np.asarray(old.to_numpy(zero_copy_only=False)).copy()
    numbers = values.astype(float) if values.dtype.kind in "fiu" else np.zeros(n)
    some = numbers.copy()
    some[:: chance.choice([1, 7])] = chance.choice([np.nan, np.inf, -np.inf, 1e308, 0.0, -1.0])
    with np.errstate(over="ignore"):
        milli = 1e3 * numbers
    new = chance.choice(
        [
            pa.array(some),
            pa.array(numbers[::-1].copy()),
            pa.array([None] * n, pa.float64()),
            pa.array(["x"] * n),
            pa.array([[1.0]] * n),
            pa.array(np.zeros(n)),
            pa.array(milli),
            pa.array(np.nan_to_num(numbers, nan=0.0, posinf=0.0, neginf=0.0).clip(-1e6, 1e6).astype(np.int64)),
            pa.array(np.arange(n), pa.timestamp("ms")),
            pa.array([True] * n),
        ]
    )
    if chance.random() < 0.2:
        return chance.choice([table.slice(0, chance.choice([0, 1, 2, 50])), table.remove_column(at)])
    if chance.random() < 0.1:
        return table.append_column(name, old)
    return table.set_column(at, name, new)
