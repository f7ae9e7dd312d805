"""Ground patches: shapes, images, overlap, and messages for impossible patches."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.spec import every
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.terrain import Flat, surface_at
from agrobot_mj.terrain.patches import MOST_CELLS, GroundPatch
from agrobot_mj.terrain.shapes import CirclePatch, PicturePatch, PolygonPatch, RectanglePatch

U_SHAPE = ((0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (4.0, 6.0), (4.0, 2.0), (2.0, 2.0), (2.0, 6.0), (0.0, 6.0))


def surface_of(*patches, half=50.0):
    return Flat(half_size_m=half, patch=patches).ground().surface


def friction(surface, x, y):
    return surface_at(surface, x, y)[0]


def test_patch_tests_include_every_patch_shape():
    assert {patch.model_fields["kind"].default for patch in every(GroundPatch)} == {
        "rectangle",
        "circle",
        "polygon",
        "image",
    }


def test_polygon_patch_may_be_concave_with_corners_in_either_order():
    for points in (U_SHAPE, U_SHAPE[::-1], U_SHAPE[3:] + U_SHAPE[:3], (*U_SHAPE, U_SHAPE[0])):
        surface = surface_of(PolygonPatch(points=points, friction=0.5))
        for x, y in ((1.0, 5.0), (5.0, 5.0), (3.0, 1.0)):
            assert friction(surface, x, y) == 0.5
        for x, y in ((3.0, 4.0), (-1.0, 3.0), (7.0, 3.0), (3.0, 6.5), (1.0, -0.5)):
            assert friction(surface, x, y) == 1.0


@settings(deadline=None, max_examples=30)
@given(st.floats(0.5, 20), st.floats(0.5, 20), st.floats(-180, 180), st.floats(-10, 10), st.floats(-10, 10))
def test_four_cornered_polygon_patch_equals_the_rectangle(length, width, heading, x, y):
    box = RectanglePatch(x_m=x, y_m=y, length_m=length, width_m=width, heading_deg=heading)
    c, s = np.cos(np.radians(heading)), np.sin(np.radians(heading))
    corners = [(a * length / 2, b * width / 2) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    twin = PolygonPatch(points=tuple((float(x + c * a - s * b), float(y + s * a + c * b)) for a, b in corners))
    assert twin.bounds() == pytest.approx(box.bounds())
    x, y = np.sort(np.random.default_rng(0).uniform(-25, 25, (2, 30)))
    at = x[None, :], y[:, None]
    assert np.array_equal(twin.covers(*at), box.covers(*at))


def picture(folder, values, **keys):
    file = folder / "map.png"
    Image.fromarray(np.asarray(values)).save(file)
    return PicturePatch(file=str(file), **keys)


@pytest.mark.parametrize("white", [255, 65535])
def test_image_patch_maps_grey_to_friction_and_soil_with_north_up(tmp_path, white):
    values = np.array([[0, white], [white // 5, white]], dtype=np.uint8 if white == 255 else np.uint16)
    patch = picture(
        tmp_path,
        values,
        width_m=8.0,
        x_m=10.0,
        friction=0.4,
        friction_white=0.9,
        cone_index_kpa=300.0,
        cone_index_white_kpa=1300.0,
    )
    surface = surface_of(patch)
    assert surface_at(surface, 8.0, 2.0) == pytest.approx((0.4, 3e5))
    assert surface_at(surface, 12.0, 2.0) == pytest.approx((0.9, 13e5))
    assert surface_at(surface, 8.0, -2.0) == pytest.approx((0.5, 5e5))
    assert surface_at(surface, 14.1, 0.0) == (1.0, 0.0)
    assert surface_at(surface, 5.9, 0.0) == (1.0, 0.0)


def test_image_patch_keeps_its_aspect_ratio_and_a_constant_friction(tmp_path):
    patch = picture(tmp_path, np.array([[0, 255, 7, 9], [1, 2, 3, 4]], dtype=np.uint8), width_m=20.0, friction=0.7)
    assert patch.bounds() == (-10.0, 10.0, -5.0, 5.0)
    surface = surface_of(patch)
    assert surface.friction == pytest.approx(np.full((40, 80), 0.7))
    assert not surface.cone_index.any()


def test_changed_patch_image_is_read_again(tmp_path):
    terrain = Flat(patch=(picture(tmp_path, np.zeros((4, 4), dtype=np.uint8), friction=0.4, friction_white=0.8),))
    assert friction(terrain.ground().surface, 0, 0) == pytest.approx(0.4)
    picture(tmp_path, np.full((5, 5), 255, dtype=np.uint8))
    assert friction(terrain.ground().surface, 0, 0) == pytest.approx(0.8)


def test_last_of_several_overlapping_patches_determines_the_ground():
    wet, dry = CirclePatch(friction=0.5, cone_index_kpa=500.0), CirclePatch(radius_m=2.0, friction=0.9)
    assert surface_at(surface_of(wet, dry), 0.3, 0.3) == (0.9, 0.0)
    assert surface_at(surface_of(dry, wet), 0.3, 0.3) == (0.5, 5e5)


@pytest.mark.parametrize(
    "patch",
    [
        RectanglePatch(length_m=900.0, width_m=900.0),
        RectanglePatch(length_m=999.0, width_m=5.0, cell_m=0.01),
        RectanglePatch(length_m=900.0, width_m=300.0, cell_m=0.01),
    ],
)
def test_too_many_patch_cells_are_rejected_with_a_valid_cell_size(patch):
    with pytest.raises(
        ValueError, match=r"^patch: \d+ x \d+ cells are more than 4000000; make cell_m larger, e\.g\. "
    ) as e:
        surface_of(patch, half=500.0)
    cell = float(str(e.value).rpartition(" ")[2])
    cells = surface_of(patch.model_copy(update={"cell_m": cell}), half=500.0).friction.size
    assert 0.5 * MOST_CELLS < cells <= MOST_CELLS


BAD = [
    ('kind = "polygon"\npoints = [[0, 0], [1, 0]]', "terrain.patch[0].points: "),
    (
        'kind = "polygon"\npoints = [[0, 0], [1, 0], [0, 0]]',
        "terrain.patch[0].points: the polygon has fewer than 3 different",
    ),
    ('kind = "polygon"\npoints = [[0, 0], [1, 0], [nan, 0]]', "terrain.patch[0].points"),
    ('kind = "polygon"\npoints = [[900, 0], [901, 0], [900, 1]]', "terrain.patch[0]: the patch is outside the field"),
    (
        'kind = "polygon"\npoints = [[0, 0], [5, 1], [10, 2]]',
        "terrain.patch[0].points: all corners are on one line; add",
    ),
    ('kind = "polygon"\npoints = [[0, 0], [1e300, 0], [0, 1]]', "terrain.patch[0].points[1][0]: must be at most 1e+09"),
    ('kind = "rectangle"\nlength_m = -3', "terrain.patch[0].length_m: must be above 0"),
    (
        'kind = "circle"\nradius_m = 0.01',
        "terrain.patch[0]: the patch covers no cell of 0.25 m; enlarge the patch or reduce cell_m",
    ),
    ('kind = "circle"\ncell_m = 1e-300', "terrain.patch[0].cell_m: must be at least 0.01"),
    (
        'kind = "circle"\n' + '[[terrain.patch]]\nkind = "circle"\n' * 1000,
        "terrain.patch: must have at most 1000 items",
    ),
    ('kind = "circle"\nx_m = 600', "terrain.patch[0]: the patch is outside the field"),
    ('kind = "image"', "terrain.patch[0].file: is missing"),
    ('kind = "image"\nfile = "none.png"', "terrain.patch[0].file: none.png: no such file in "),
    ('kind = "image"\nfile = "map.npy"', "terrain.patch[0].file: map.npy: "),
    ('kind = "image"\nfile = "text.png"', "terrain.patch[0].file: text.png: the file is not a PNG image"),
    ('kind = "image"\nfile = "rgb.png"', "terrain.patch[0].file: rgb.png: the image has type RGB"),
    ('kind = "image"\nfile = "grey.png"\ncone_index_white_kpa = 9.0', "terrain.patch[0].cone_index_white_kpa: needs"),
    ('kind = "image"\nfile = "grey.png"\nx_m = 1e4', "terrain.patch[0]: the patch is outside the field"),
    ('kind = "square"', "terrain.patch[0].kind: unknown kind 'square'"),
]


@pytest.mark.parametrize(("table", "what"), BAD)
def test_error_for_an_impossible_patch_names_its_number_and_key(tmp_path, table, what):
    (tmp_path / "text.png").write_text("hello")
    (tmp_path / "map.npy").write_text("hello")
    Image.fromarray(np.zeros((5, 5, 3), dtype=np.uint8)).save(tmp_path / "rgb.png")
    Image.fromarray(np.zeros((5, 5), dtype=np.uint8)).save(tmp_path / "grey.png")
    (tmp_path / "field.toml").write_text(f"[[terrain.patch]]\n{table}\n")
    with pytest.raises(ScenarioError) as error:
        load_scenario(tmp_path / "field.toml")
    assert f"field.toml: {what}" in str(error.value)
