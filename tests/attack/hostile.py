"""Hostile values for all classes of inputs, and functions that damage the bytes, cells or arrays of files."""

import io
import random
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

from agrobot_mj.core.resources import SCENARIOS
from agrobot_mj.terrain.geotiff import write_tiff

NUMBERS = ("nan", "inf", "-inf", "0", "-0.0", "-1", "1e308", "-1e308", "1e999", "5e-324", "1e9", "0x10", "0b1", "1_0")
NUMBERS += ("0.9999999999999999", "9" * 400, "9" * 5000)
"""Texts that the tests use in place of a number."""
VALUES = (
    *NUMBERS,
    *("", " ", ".", "..", "-", "--", "*", "=", ":", ",", "None", "true", "é", "\ud800", "[bold]", "\x1b[31m", "a\nb"),
    *("%s", "{}", "[]", "x" * 5000, "x/" * 2000, "no/such", "0x" + "f" * 5000, "../../etc/passwd", "lambda: 0"),
    *("1:2", "2:1", "nan:1", "1:1", "0:1e308", "1/0", "0/2", "3/2", "1/2/3", "a=b", "a:", ":=", "a:b=c,d=["),
    *("pd,", "pd,pd", "lqr,nope", "xte_rms", "__class__", "outcome == 'x'", "1 < 2 <", "tcp://", "circle"),
    *("run", "small.toml", "pipe", "null", "mine.py"),
    *('""', "'\\\\'", '"\\u001b[31m"', '"[/bold]"', '"' + "x" * 50_000 + '"', "1979-05-27", "[" * 3000, "[[[["),
    *("[nan]", "[[0]]", "[1, 2, 3]", "{x=1}", "{ kind = 1 }", "{ from = 0, to = 1, count = 3 }"),
)
"""Values that no key or option accepts, and values that are valid only for other keys."""
BITS = (b"nan", b"-", b"1e999", b"\xff", b"", b",", b"\n", b"\x00" * 4)
CONTENTS = (b"", b"[]", b"{}", b"null", b"3", b'{"a": 1}', b"[" * 3000, b"[{}]", b"\xff\xfe", b'[{"t": "x"}]', b"nan")
"""Contents that replace the content of a file."""


def bent(chance: random.Random, content: bytes, most: int = 20) -> bytes:
    """Return the content of a file with some changed bytes. The content may also be truncated."""
    changed = bytearray(content)
    for _ in range(chance.randint(1, most)):
        at = chance.randrange(len(changed))
        if chance.random() < 0.5:
            changed[at] ^= 1 << chance.randrange(8)
        else:
            changed[at : at + chance.randint(0, 3)] = chance.choice(BITS)
    return bytes(changed[: chance.choice([len(changed), len(changed), chance.randrange(len(changed))])])


def odd_lines(chance: random.Random, file: Path) -> bytes:
    """Return the content of a text file with some changed lines."""
    lines = file.read_bytes().split(b"\n")
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(lines))
        line, odd = lines[at], chance.choice(VALUES).encode(errors="surrogatepass")
        changed = [line[: len(line) // 2], line + line, chance.randbytes(5), line.partition(b"=")[0] + b"= " + odd, b""]
        lines[at] = chance.choice(changed)
    return b"\n".join(lines)


def spoil(chance: random.Random, file: Path) -> str:
    """Change, replace or remove a file, or replace the file by a folder. Return the kind of damage."""
    how = chance.choice(["bent", "bent", "replaced", "replaced", "removed", "a folder"])
    if how == "bent":
        file.write_bytes(bent(chance, file.read_bytes(), 3))
    elif how == "replaced":
        file.write_bytes(chance.choice(CONTENTS))
    else:
        file.unlink()
        if how == "a folder":
            file.mkdir()
    return how


def terrain_files() -> dict[str, bytes]:
    """Return valid height and waypoint files by name."""
    heights = np.cumsum(np.random.default_rng(1).normal(0, 0.01, (64, 64)), axis=0)
    array, picture = io.BytesIO(), io.BytesIO()
    np.save(array, heights)
    Image.fromarray((heights * 1000 + 30_000).astype(np.uint16)).save(picture, "png")
    found = {name: (SCENARIOS / name).read_bytes() for name in ("hills.asc", "waypoints.csv")}
    found |= {"heights.npy": array.getvalue(), "heights.png": picture.getvalue()}
    with TemporaryDirectory() as folder:
        for name, kind in {"float.tif": np.float32, "whole.tif": np.int32}.items():
            write_tiff(Path(folder, name), heights[:8, :8].astype(kind), (0.5, 0.5), (6e5, 5e6), False, -9999)
            found[name] = Path(folder, name).read_bytes()
    return found


def odd_array(chance: random.Random) -> bytes:
    """Return an array file whose type or shape is invalid for heights."""
    kind = chance.choice(["f8", "f4", "i8", "u1", "c16", "U3", "M8[s]", "?", ">f8", "f2"])
    shape = chance.choice([(8, 8), (0,), (1, 1), (4,), (2, 2, 2), (3, 0), (2000, 2)])
    array, out = np.ones(shape, dtype="f8").astype(kind), io.BytesIO()
    if array.size and array.dtype.kind == "f":
        with np.errstate(over="ignore"):
            array.flat[0] = chance.choice([np.nan, np.inf, -1e30, 1e308])
    np.save(out, array)
    return out.getvalue()


def spoil_parquet(chance: random.Random, file: Path) -> None:
    """Change bytes of a Parquet file, or one or two of its columns."""
    if chance.random() < 0.3:
        file.write_bytes(bent(chance, file.read_bytes(), 3))
        return
    table = pq.read_table(file)
    for _ in range(chance.randint(1, 2)):
        table = _odd_table(chance, table)
    pq.write_table(table, file, compression=chance.choice(["zstd", "snappy", "none"]))


def _odd_table(chance: random.Random, table: pa.Table) -> pa.Table:
    """Return a copy of a table with changed rows or with one changed column."""
    names = ("t", "valve_voltage", "steer_measured", "x", "y", "yaw", "speed", "steer")
    names = (*names, chance.choice(table.column_names))
    name = chance.choice([name for name in names if name in table.column_names] or table.column_names)
    at, n = table.column_names.index(name), len(table)
    old = table.column(at)  # the name may occur twice
    if chance.random() < 0.2:
        return chance.choice([table.slice(0, chance.choice([0, 1, 2, 50])), table.remove_column(at)])
    if chance.random() < 0.1:
        return table.append_column(name, old)
    return table.set_column(at, name, _odd_column(chance, np.asarray(old.to_numpy(zero_copy_only=False)), n))


def _odd_column(chance: random.Random, values: np.ndarray, n: int) -> Any:
    """Return a column that replaces `values` (n,): other numbers, other types, or missing values."""
    numbers = values.astype(float) if values.dtype.kind in "fiu" else np.zeros(n)
    some = numbers.copy()
    some[:: chance.choice([1, 7])] = chance.choice([np.nan, np.inf, -np.inf, 1e308, 0.0, -1.0])
    with np.errstate(over="ignore"):
        milli = 1e3 * numbers
    whole = np.nan_to_num(numbers, nan=0.0, posinf=0.0, neginf=0.0).clip(-1e6, 1e6).astype(np.int64)
    columns = [some, numbers[::-1].copy(), np.zeros(n), milli, whole, [True] * n, ["x"] * n, [[1.0]] * n]
    typed = [pa.array([None] * n, pa.float64()), pa.array(np.arange(n), pa.timestamp("ms"))]
    return chance.choice([*map(pa.array, columns), *typed])
