"""Reading of heights and images: NumPy arrays, grey PNG images, ESRI ASCII grids, GeoTIFF and Elevation.txt.

Each reader checks the file size and the header before it reads the numbers. Errors are ValueErrors that begin with
`file: NAME: ` and state the fix.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.resources import checked_path, refuse, stamp_of
from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import HUGE
from agrobot_mj.terrain.elevation import read_elevation
from agrobot_mj.terrain.geotiff import HEIGHT_MODES, cell_and_corner, open_tiff, without_gaps
from agrobot_mj.terrain.grid import MOST_NODES

MOST_BYTES = 128 * 1024**2  # Maximum size of a file, sufficient for the largest grid as text [bytes]
GREY = {"L": 255, "I;16": 65535, "I;16B": 65535, "I": 65535}
FINEST_M = 0.01  # Minimum cell size of an ESRI grid [m]. A smaller cell size is probably in degrees.
HEADER = {"ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", "dx", "dy", "nodata_value"}
"""Keys accepted in the header of an ESRI grid."""
LONGEST_HEAD = 2000  # Maximum length of the header of an ESRI grid [characters]


class Sheet(NamedTuple):
    """Grid of numbers read from a file."""

    values: Array  # Numbers of the grid, shape (rows, columns); row 0 is the south edge
    cell: float | None = None  # Distance between nodes [m], or None if the file does not contain the distance
    white: float = 1.0  # Number that represents white in an image
    corner: tuple[float, float] | None = None
    """Easting and northing of the south-west node on a map [m], or None if the file contains no position."""
    local: bool = False  # Whether the map is the local plane of a field, whose origin is its start fix
    notes: tuple[str, ...] = ()  # Sentences about interpolation


def read_grid(file: str) -> Sheet:
    """Return the grid of finite numbers, at least 2 x 2, in a `.npy`, `.png`, `.asc`, `.tif` or `Elevation.txt` file.

    Raises ValueError for a file that cannot be used.
    """
    with _prefix_file_key():
        path = checked_path(file, list(READERS), MOST_BYTES)
        sheet = READERS[path.suffix.lower()](path)
        _fits(path, sheet.values.shape)
        if bad := np.argwhere(~np.isfinite(sheet.values)).tolist():
            value = sheet.values[tuple(bad[0])]
            refuse(path, f"the file has {'NaN' if np.isnan(value) else 'inf'} at {len(bad)} nodes; replace them")
        return sheet


def read_picture(file: str) -> Array:
    """Return the brightness of a grey PNG image from 0 (black) to 1 (white), shape (rows, columns); row 0 is south."""
    with _prefix_file_key():
        sheet = _read_png(checked_path(file, [".png"], MOST_BYTES))
        return sheet.values / sheet.white


@contextmanager
def _prefix_file_key() -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise ValueError(f"file: {error}") from None


def _fits(path: Path, shape: tuple[int, ...]) -> None:
    if len(shape) != 2:
        refuse(path, f"the array has {len(shape)} dimensions; store heights as an array of rows and columns")
    rows, columns = shape
    if min(shape) < 2:
        refuse(path, f"the grid has {rows} x {columns} nodes; at least 2 x 2 are required")
    if rows * columns > MOST_NODES:
        refuse(path, f"the grid has {rows} x {columns} nodes, but the limit is {MOST_NODES}; crop or downsample it")


def _try(path: Path, fix: str, read: Callable[[], Any]) -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # e.g. numpy's warning for a header with an impossible size
            return read()
    except Exception as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        refuse(path, f"cannot be read ({reason}); {fix}")


def _read_npy(path: Path) -> Sheet:
    mapped = _try(path, "save it with numpy.save, with numbers only", lambda: np.lib.format.open_memmap(path, mode="r"))
    if mapped.dtype.kind not in "fiu":
        refuse(path, f"the file has values of type {mapped.dtype}; store real numbers, e.g. float32")
    _fits(path, mapped.shape)
    with np.errstate(over="ignore", invalid="ignore"):
        return Sheet(np.array(mapped, dtype=np.float64))


def _read_png(path: Path) -> Sheet:
    from PIL import Image  # imported here: most terrains need no image

    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        try:
            picture = Image.open(path, formats=["PNG"])
        except (Image.DecompressionBombWarning, Image.DecompressionBombError):
            refuse(path, f"the image exceeds the limit of {MOST_NODES} pixels by far; crop it or reduce its resolution")
        except Exception:
            refuse(path, "the file is not a PNG image; export the file again as a grey PNG of 16 bits")
    with picture, path.open("rb") as stream:
        _fits(path, (picture.height, picture.width))
        if picture.mode not in GREY:
            refuse(path, f"the image has type {picture.mode}; export it as grey of 16 (or 8) bits without alpha")
        # `verify` compares the checksums, which reading ignores
        _try(path, "export the file again", lambda: Image.open(stream, formats=["PNG"]).verify())
        values = _try(path, "export the file again", lambda: np.asarray(picture, dtype=np.float64))
        return Sheet(np.flipud(values), white=GREY[picture.mode])


def _read_asc(path: Path) -> Sheet:
    head = _head_of(path)
    shape, cell = _shape_of(path, head), _cell_of(path, head)
    _fits(path, shape)
    words = _text(path)[2 * len(head) :]
    if len(words) != shape[0] * shape[1]:
        refuse(
            path,
            f"the file has {len(words)} values, but its header gives {shape[0]} x {shape[1]} = {shape[0] * shape[1]}; "
            "it is truncated or its header is wrong; export the file again",
        )
    values = _try(path, "use numbers with a decimal point", lambda: np.array(words, dtype=np.float64)).reshape(shape)
    if (holes := int((values == head.get("nodata_value", np.nan)).sum())) > 0:
        refuse(path, f"the grid has {holes} missing values (NODATA); fill them, e.g. with gdal_fillnodata")
    return Sheet(np.flipud(values), cell, corner=_corner_of(head, cell))


def _corner_of(head: dict[str, float], cell: float) -> tuple[float, float] | None:
    """Return the easting and northing of the south-west cell centre [m], or None for a header without a position."""
    west, south = (head.get(f"{axis}llcenter", head.get(f"{axis}llcorner", np.nan) + cell / 2) for axis in ("x", "y"))
    return (west, south) if np.isfinite([west, south]).all() else None


def _read_tiff(path: Path) -> Sheet:
    with open_tiff(path) as image:
        _fits(path, (image.height, image.width))
        if image.mode not in HEIGHT_MODES:
            refuse(path, f"the image has type {image.mode}; export one band of numbers, e.g. with gdal_translate -b 1")
        cell, corner = cell_and_corner(path, image)
        _in_metres(path, cell)
        read = _try(path, "export the file again without compression", lambda: np.asarray(image, dtype=np.float64))
        return Sheet(without_gaps(path, read, image.tag_v2), cell, corner=corner)


def _read_elevation(path: Path) -> Sheet:
    found = read_elevation(stamp_of(str(path), (), MOST_BYTES))
    ground = found.ground
    return Sheet(ground.heights, ground.spacing, corner=(ground.x0, ground.y0), local=True, notes=found.notes)


def _text(path: Path, size: int = -1) -> list[str]:

    def read() -> list[str]:
        with path.open(encoding="utf-8-sig") as stream:
            return stream.read(size).split()

    words: list[str] = _try(path, "export the file again as ESRI ASCII grid", read)
    return words


def _head_of(path: Path) -> dict[str, float]:
    found: dict[str, float] = {}
    words = _text(path, LONGEST_HEAD)
    for word, number in zip(words[::2], words[1::2], strict=False):
        key = word.lower()
        if key not in HEADER:
            break
        if key in found:
            refuse(path, f"the header contains {key} twice; remove one")
        found[key] = _try(path, f"set {word} to a number", partial(float, number))
    return found


def _shape_of(path: Path, head: dict[str, float]) -> tuple[int, int]:
    for key in ("nrows", "ncols"):
        if key not in head:
            refuse(path, f"the header has no {key}; export the file again as an ESRI ASCII grid")
        if not (1 <= head[key] < 1e9 and head[key] == int(head[key])):
            refuse(path, f"the header has {key} {head[key]:g}, which must be a whole number above 0")
    return int(head["nrows"]), int(head["ncols"])


def _cell_of(path: Path, head: dict[str, float]) -> float:
    dx, dy = head.get("dx", head.get("cellsize")), head.get("dy", head.get("cellsize"))
    if dx is None or dy is None:
        refuse(path, "the header has no cellsize; export the file again as an ESRI ASCII grid")
    if not (0 < dx < np.inf and 0 < dy < np.inf):
        refuse(path, f"the header has cellsize {dx:g}, which must be above 0 m")
    if dx != dy:
        refuse(
            path,
            f"the cells are {dx:g} x {dy:g} m; resample them to squares, e.g. with gdalwarp -tr {dx:g} {dx:g}",
        )
    _in_metres(path, dx)
    return dx


def _in_metres(path: Path, cell: float) -> None:
    if not FINEST_M <= cell <= HUGE:
        refuse(path, f"the cells are {cell:g} m; if these are degrees, reproject to metres with gdalwarp -t_srs")


READERS: dict[str, Callable[[Path], Sheet]] = {
    ".npy": _read_npy,
    ".png": _read_png,
    ".asc": _read_asc,
    ".tif": _read_tiff,
    ".tiff": _read_tiff,
    ".txt": _read_elevation,
}
