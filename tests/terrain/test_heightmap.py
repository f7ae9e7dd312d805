"""Heightmaps: file formats, orientation, and messages for invalid files."""

import io
from math import cos, radians, sin, tan

import numpy as np
import pytest
from PIL import Image

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.plants.driver import Driver, mujoco_plant
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.terrain import Heightmap, Slope
from agrobot_mj.terrain.files import MOST_BYTES
from agrobot_mj.tyres import MagicFormula

HILL = np.array([[0.0, 1.0, 2.0], [10.0, 11.0, 12.0], [20.0, 21.0, 22.0]]) / 20
"""Heights that rise by a metre from north (row 0) to south, and by 0.1 m from west to east."""
HEAD = "ncols 3\nnrows 3\nxllcorner 600000\nyllcorner 5e6\ncellsize 2.5\nNODATA_value -9999\n"


def asc(values, head=HEAD):
    return head + "\n".join(" ".join(f"{v:g}" for v in row) for row in values) + "\n"


def png(values, mode=None):
    stream = io.BytesIO()
    Image.fromarray(values, mode).save(stream, "PNG")
    return stream.getvalue()


def test_first_row_of_an_array_heightmap_is_its_south_edge(tmp_path):
    np.save(tmp_path / "hill.npy", HILL[::-1])
    ground = Heightmap(file=str(tmp_path / "hill.npy"), spacing_m=2.5, offset_m=7.0, scale=2.0).ground()
    assert ground.extent == (-2.5, 2.5, -2.5, 2.5)
    assert ground.heights == pytest.approx(7.0 + 2.0 * HILL[::-1])


def test_first_row_of_an_esri_grid_is_its_north_edge(tmp_path):
    (tmp_path / "hill.asc").write_text(asc(HILL))
    ground = Heightmap(file=str(tmp_path / "hill.asc")).ground()
    assert ground.extent == (-2.5, 2.5, -2.5, 2.5)
    assert ground.heights == pytest.approx(HILL[::-1])


@pytest.mark.parametrize(("kind", "unit"), [(np.uint16, 1 / 20), (np.uint8, 1 / 20)])
def test_first_row_of_an_image_heightmap_is_its_north_edge(tmp_path, kind, unit):
    (tmp_path / "hill.png").write_bytes(png((20 * HILL).round().astype(kind)))
    ground = Heightmap(file=str(tmp_path / "hill.png"), scale=unit).ground()
    assert ground.extent == (-1.0, 1.0, -1.0, 1.0)
    assert ground.heights == pytest.approx(HILL[::-1])


def test_all_16_bits_of_an_image_heightmap_are_read(tmp_path):
    (tmp_path / "fine.png").write_bytes(png(np.array([[0, 1], [65534, 65535]], dtype=np.uint16)))
    ground = Heightmap(file=str(tmp_path / "fine.png"), scale=1e-5).ground()
    assert 1e5 * ground.heights == pytest.approx(np.array([[65534, 65535], [0, 1]]))


def test_esri_grid_may_be_rectangular_with_wrapped_rows_and_capitals(tmp_path):
    values = np.arange(8.0).reshape(2, 4) / 10
    head = "NCOLS 4\nNROWS 2\nXLLCENTER 0\nYLLCENTER 0\nDX 3\nDY 3\n"
    (tmp_path / "strip.ASC").write_text(head + "\n".join(f"{v:g}" for v in values.ravel()))
    ground = Heightmap(file=str(tmp_path / "strip.ASC")).ground()
    assert ground.extent == (-4.5, 4.5, -1.5, 1.5)
    assert ground.heights == pytest.approx(values[::-1])


def test_rectangular_array_heightmap_needs_the_rectangular_key(tmp_path):
    np.save(tmp_path / "strip.npy", np.zeros((2, 5), dtype=np.int16))
    with pytest.raises(
        ValueError, match=r"^file: strip\.npy: the grid has 2 rows and 5 columns; set rectangular = true"
    ):
        Heightmap(file=str(tmp_path / "strip.npy")).ground()
    assert Heightmap(file=str(tmp_path / "strip.npy"), rectangular=True).ground().extent == (-2, 2, -0.5, 0.5)


def test_changed_heightmap_file_is_read_again(tmp_path):
    file = tmp_path / "hill.npy"
    np.save(file, np.zeros((3, 3)))
    terrain = Heightmap(file=str(file))
    assert not terrain.ground().heights.any()
    np.save(file, np.full((4, 4), 0.5))
    assert terrain.ground().heights == pytest.approx(np.full((4, 4), 0.5))


def test_scenario_with_the_shipped_heightmap_runs():
    ground = Heightmap().ground()
    assert ground.extent == (-100, 100, -80, 80)
    assert 5 < np.ptp(ground.heights) < 20
    assert ground.steepest < tan(radians(15))


def test_heightmap_of_a_plane_equals_the_slope_terrain(tmp_path):
    """Heights are equal, and the run on the height field agrees with the run on a plane up to rounding.

    The load acts in the wheel plane, because the coupling of lean and carcass exists on planes only.
    """
    slope = Slope(grade_deg=8.0, direction_deg=130.0, half_size_m=30.0)
    nodes = np.linspace(-30.0, 30.0, 61)
    heights = tan(radians(8)) * (cos(radians(130)) * nodes[None, :] + sin(radians(130)) * nodes[:, None])
    np.save(tmp_path / "plane.npy", heights)
    plane = Heightmap(file=str(tmp_path / "plane.npy"))
    assert plane.ground().heights[[0, 0, -1, -1], [0, -1, 0, -1]] == pytest.approx(slope.ground().heights.ravel())
    traces = []
    for terrain in (slope, plane):
        plant, truth = mujoco_plant(MagicFormula(load_follows_carcass=False), terrain)
        traces.append((plant, Driver(plant, truth, 1.0).go(8.0, steer=0.1)))
    (on_plane, first), (on_field, second) = traces
    assert on_plane.model.geom("ground").type != on_field.model.geom("ground").type
    for signal in ("x", "y", "z", "yaw", "roll", "pitch", "speed", "yaw_rate"):
        assert second[signal] == pytest.approx(first[signal], abs=1e-6), signal
    assert second.wheels[:, 0] == pytest.approx(first.wheels[:, 0], rel=1e-4)
    assert first["x"][-1] > 5.0


# --- malformed ----------------------------------------------------------------------------------------------------


def saved(values, **options):
    stream = io.BytesIO()
    np.save(stream, values, **options)
    return stream.getvalue()


def huge_header():
    """Return an array file with a header for 4 TB and no data."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (2**20, 2**19)})
    return stream.getvalue()


def pickled():
    return saved(np.array([[{}, 1], [2, 3]], dtype=object))


def patched(data, old, new):
    assert old in data
    return data.replace(old, new)


def bomb():
    """Return a PNG file with a header for 30000 x 30000 pixels."""
    import struct
    import zlib

    def chunk(name, body):
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    head = struct.pack(">IIBBBBB", 30000, 30000, 16, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


GREY = png(np.random.default_rng(1).integers(0, 65535, (200, 200), dtype=np.uint16))
BAD = {
    "none.npy": (None, "no such file in "),
    "folder.npy": ("folder", "is a folder"),
    "empty.npy": (b"", "is empty"),
    "empty.asc": (b"", "is empty"),
    "notes.doc": (b"hello", "unknown file type '.doc'; convert the file to one of .npy, .png, .asc"),
    "bare": (b"hello", "unknown file type ''"),
    "text.npy": (b"hello world, this is text", "cannot be read"),
    "short.npy": (saved(np.zeros((20, 20)))[:-9], "cannot be read"),
    "headless.npy": (saved(np.zeros((20, 20)))[:20], "cannot be read"),
    "nan.npy": (saved(np.array([[0.0, np.nan], [0.0, 0.0]])), "has NaN at 1 nodes; replace them"),
    "inf.npy": (saved(np.array([[0.0, np.inf], [0.0, -np.inf]])), "has inf at 2 nodes; replace them"),
    "words.npy": (saved(np.array([["a", "b"], ["c", "d"]])), "has values of type <U1; store real numbers"),
    "complex.npy": (saved(np.zeros((2, 2), dtype=complex)), "has values of type complex128"),
    "flags.npy": (saved(np.zeros((2, 2), dtype=bool)), "has values of type bool"),
    "dates.npy": (saved(np.zeros((2, 2), dtype="M8[s]")), "has values of type datetime64[s]"),
    "record.npy": (saved(np.zeros((2, 2), dtype=[("z", "f8")])), "has values of type"),
    "pickled.npy": (pickled(), "cannot be read"),
    "line.npy": (saved(np.zeros(9)), "has 1 dimensions"),
    "scalar.npy": (saved(np.array(3.0)), "has 0 dimensions"),
    "cube.npy": (saved(np.zeros((2, 2, 2))), "has 3 dimensions"),
    "row.npy": (saved(np.zeros((1, 9))), "has 1 x 9 nodes; at least 2 x 2"),
    "nothing.npy": (saved(np.zeros((0, 5))), ""),
    "huge.npy": (huge_header(), ""),
    "large.npy": (saved(np.zeros((2100, 2001), dtype=np.uint8)), "has 2100 x 2001 nodes, but the limit is 4200000"),
    "wide.npy": (saved(np.zeros((2, 3))), "has 2 rows and 3 columns; set rectangular = true"),
    "negative.npy": (patched(saved(np.zeros((20, 20))), b"(20, 20)", b"(-2, 20)"), "cannot be read"),
    "text.png": (b"hello", "the file is not a PNG image"),
    "jpeg.png": (patched(GREY, b"\x89PNG", b"\xff\xd8\xff\xe0"), "the file is not a PNG image"),
    "short.png": (GREY[:-20000], "cannot be read"),
    "bent.png": (GREY[:-40] + b"xx" + GREY[-38:], "cannot be read (broken PNG file"),
    "colour.png": (png(np.zeros((5, 5, 3), dtype=np.uint8)), "the image has type RGB; export it as grey"),
    "alpha.png": (png(np.zeros((5, 5, 2), dtype=np.uint8)), "the image has type LA"),
    "wide.png": (png(np.zeros((3, 5), dtype=np.uint8)), "has 3 rows and 5 columns; set rectangular = true"),
    "bomb.png": (bomb(), "the limit"),
    "letters.asc": (b"hello world", "the header has no nrows"),
    "binary.asc": (b"ncols \xff\xfe", "cannot be read"),
    "nosize.asc": (asc(HILL, HEAD.replace("cellsize 2.5\n", "")).encode(), "the header has no cellsize"),
    "zero.asc": (asc(HILL, HEAD.replace("2.5", "0")).encode(), "the header has cellsize 0"),
    "degrees.asc": (
        asc(HILL, HEAD.replace("2.5", "2.8e-4")).encode(),
        "the cells are 0.00028 m; if these are degrees",
    ),
    "utf16.asc": (asc(HILL).encode("utf-16"), "cannot be read"),
    "word.asc": (asc(HILL, HEAD.replace("2.5", "wide")).encode(), "cannot be read (could not convert"),
    "half.asc": (asc(HILL, HEAD.replace("nrows 3", "nrows 2.5")).encode(), "the header has nrows 2.5"),
    "nan.asc": (asc(HILL, HEAD.replace("nrows 3", "nrows nan")).encode(), "the header has nrows nan"),
    "twice.asc": (asc(HILL, "ncols 3\n" + HEAD).encode(), "the header contains ncols twice"),
    "oblong.asc": (
        asc(HILL, HEAD.replace("cellsize 2.5", "dx 2.5\ndy 3")).encode(),
        "the cells are 2.5 x 3 m; resample",
    ),
    "few.asc": (asc(HILL[:2]).encode(), "has 6 values, but its header gives 3 x 3 = 9; it is truncated"),
    "many.asc": (asc([*HILL, HILL[0]]).encode(), "has 12 values, but its header gives 3 x 3 = 9"),
    "comma.asc": (asc(HILL).replace("0.5", "0,5").encode(), "use numbers with a decimal point"),
    "holes.asc": (asc([[-9999, 0, 0], [0, 0, 0], [0, -9999, 0]]).encode(), "has 2 missing values (NODATA); fill them"),
    "lost.asc": (asc(HILL).replace("0.5 ", "nan ").encode(), "has NaN at 1 nodes"),
    "large.asc": (HEAD.replace("ncols 3", "ncols 3000000").encode(), "has 3 x 3000000 nodes, but the limit is"),
    "row.asc": (asc(HILL[:1], HEAD.replace("nrows 3", "nrows 1")).encode(), "has 1 x 3 nodes; at least 2 x 2"),
}


def lay(folder, name, content):
    if content == "folder":
        (folder / name).mkdir()
    elif content is not None:
        (folder / name).write_bytes(content)


@pytest.mark.parametrize("name", BAD)
def test_error_for_an_invalid_heightmap_names_the_file_and_a_remedy(tmp_path, name, recwarn):
    content, what = BAD[name]
    lay(tmp_path, name, content)
    (tmp_path / "field.toml").write_text(f'[terrain]\nkind = "heightmap"\nfile = "{name}"\n')
    with pytest.raises(ScenarioError) as error:
        load_scenario(tmp_path / "field.toml")
    message = str(error.value)
    assert message.startswith(f"field.toml: terrain.file: {name}: ")
    assert what in message
    assert "\n" not in message
    assert not recwarn.list


def test_heightmap_file_is_not_read_beyond_the_size_limit(tmp_path):
    with (tmp_path / "sparse.asc").open("wb") as stream:
        stream.truncate(MOST_BYTES + 1)
    with pytest.raises(ValueError, match=r"^file: sparse\.asc: the file size is 134 MB, but the limit is 134 MB; crop"):
        Heightmap(file=str(tmp_path / "sparse.asc")).ground()


def test_error_for_heights_in_the_wrong_unit_suggests_a_scale(tmp_path):
    np.save(tmp_path / "feet.npy", 1000 * HILL)
    with pytest.raises(
        ValueError, match=r"^scale: feet\.npy rises 500 m between nodes 1 m apart.*set a scale of at most 0\.0034"
    ):
        Heightmap(file=str(tmp_path / "feet.npy")).ground()
    assert Heightmap(file=str(tmp_path / "feet.npy"), scale=0.0034).ground().steepest < tan(radians(60))


def test_excessive_heightmap_values_are_reported(tmp_path):
    np.save(tmp_path / "far.npy", np.full((3, 3), 1e300))
    with pytest.raises(ValueError, match=r"^scale: the heights of far\.npy exceed 1000 km"):
        Heightmap(file=str(tmp_path / "far.npy"), scale=1e300).ground()


def test_spacing_key_is_rejected_for_a_grid_with_its_own_cell_size(tmp_path):
    (tmp_path / "hill.asc").write_text(asc(HILL))
    with pytest.raises(ValueError, match=r"^spacing_m: hill\.asc already has a cellsize of 2\.5 m; omit the key"):
        Heightmap(file=str(tmp_path / "hill.asc"), spacing_m=1.0).ground()


def test_an_esri_grid_may_begin_with_a_byte_order_mark(tmp_path):
    (tmp_path / "marked.asc").write_bytes(b"\xef\xbb\xbf" + asc(HILL).encode())
    (tmp_path / "plain.asc").write_bytes(asc(HILL).encode())
    marked, plain = (Heightmap(file=str(tmp_path / name)).ground() for name in ("marked.asc", "plain.asc"))
    assert np.array_equal(marked.heights, plain.heights)
