"""Requirements on every terrain, and agreement of MuJoCo's height field with the grid of the tyres."""

import json
from math import radians, tan

import mujoco
import numpy as np
import pytest
from pydantic import TypeAdapter
from turns import by_turns

from agrobot_mj import load_scenario, run
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import Drive, Reference
from agrobot_mj.core.spec import every
from agrobot_mj.plants.driver import mujoco_plant
from agrobot_mj.terrain import Bumps, Flat, Heightmap, Ridges, Rough, Slope, Terrain, height_and_gradient, surface_at
from agrobot_mj.terrain.generated import Generated
from agrobot_mj.terrain.grid import MOST_NODES
from agrobot_mj.terrain.rough import HIGHEST_WAVE_NUMBER, ROLL_OFF, ROUGHNESS, plane_spectrum
from agrobot_mj.terrain.shapes import CirclePatch
from agrobot_mj.tyres import Contact, MagicFormula

TERRAINS = every(Terrain)
GENERATED = [terrain for terrain in TERRAINS if issubclass(terrain, Generated)]
TILTED = [terrain for terrain in TERRAINS if "grade_deg" in terrain.model_fields]
TYRES = [pytest.param(tyre(), id=tyre.__name__) for tyre in (MagicFormula, Contact)]
TERRAINS_AND_TYRES = by_turns([pytest.param(kind, id=kind.__name__) for kind in TERRAINS], TYRES)
SMALL = {"half_size_m": 10.0}


def small(kind, **keys):
    """Return a terrain of a kind, as small as its keys permit."""
    size = SMALL if "half_size_m" in kind.model_fields else {}
    return kind(**size | ({"count": 2} if kind is Bumps else {}) | keys)


@pytest.mark.parametrize("kind", TERRAINS)
def test_terrain_grid_is_finite_centred_and_has_square_cells(kind):
    ground = small(kind).ground()
    heights = ground.heights
    assert heights.dtype == np.float64
    assert heights.flags["C_CONTIGUOUS"]
    assert np.isfinite(heights).all()
    assert min(heights.shape) >= 2
    assert heights.size <= MOST_NODES
    assert ground.covers(0.0, 0.0)
    x_min, x_max, y_min, y_max = ground.extent
    assert x_min + x_max == pytest.approx(0.0, abs=1e-9)
    assert y_min + y_max == pytest.approx(0.0, abs=1e-9)
    if "half_size_m" in kind.model_fields:
        assert (x_max, y_max) == pytest.approx((10.0, 10.0))


@pytest.mark.parametrize("kind", TERRAINS)
def test_terrain_is_the_same_for_equal_settings_and_seeds(kind):
    first = kind().relief().heights
    assert np.array_equal(first, kind().relief().heights)


@pytest.mark.parametrize("kind", [kind for kind in TERRAINS if "seed" in kind.model_fields])
def test_another_seed_gives_different_heights_with_equal_statistics(kind):
    keys = {"layout": "scattered", "count": 40} if kind is Bumps else {}
    one, other = (small(kind, **{**keys, "seed": seed}).ground().heights for seed in (1, 2))
    assert not np.allclose(one, other, atol=1e-3)
    assert one.std() == pytest.approx(other.std(), rel=0.4)


@pytest.mark.parametrize("kind", TERRAINS)
def test_patches_can_be_placed_on_every_terrain(kind):
    surface = small(kind, patch=(CirclePatch(radius_m=2.0, friction=0.5),)).ground().surface
    assert surface_at(surface, 0.5, 0.5)[0] == 0.5
    assert surface_at(surface, 3.0, 3.0)[0] == 1.0


@pytest.mark.parametrize("kind", TILTED)
def test_tilted_terrain_equals_level_terrain_plus_a_plane(kind):
    level, tilted = (small(kind, grade_deg=grade, direction_deg=30.0).ground() for grade in (0.0, 12.0))
    rows, columns = level.heights.shape
    x = level.x0 + level.spacing * np.arange(columns)
    y = level.y0 + level.spacing * np.arange(rows)
    rise = tan(radians(12.0)) * (np.cos(radians(30.0)) * x[None, :] + np.sin(radians(30.0)) * y[:, None])
    assert tilted.heights - level.heights == pytest.approx(rise, abs=1e-9)


@pytest.mark.parametrize("kind", GENERATED)
def test_run_in_area_is_level_and_blends_into_the_relief(kind):
    plain, faded = (
        small(kind, run_in_m=run_in, **({"x_m": 1.0} if kind is Bumps else {})).ground() for run_in in (0.0, 3.0)
    )
    nodes = np.linspace(-10.0, 10.0, plain.heights.shape[0])
    r = np.hypot(nodes[None, :], nodes[:, None])
    assert plain.heights[r < 2.9].any()
    assert not faded.heights[r < 2.9].any()
    assert np.array_equal(faded.heights[r > 6.1], plain.heights[r > 6.1])
    middle = (r > 4.4) & (r < 4.6)
    assert faded.heights[middle] == pytest.approx(plain.heights[middle] / 2, abs=0.06 * np.abs(plain.heights).max())


@pytest.mark.parametrize("kind", GENERATED)
def test_error_for_too_many_terrain_nodes_states_valid_values(kind):
    with pytest.raises(
        ValueError, match=r"^node_m: 3201 x 3201 nodes are more than 4200000; set node_m to .*"
    ) as error:
        kind(half_size_m=80.0, node_m=0.05).ground()
    node, half = (float(part.split()[0]) for part in str(error.value).partition("set ")[2].split(" to ")[1:])
    for fits in (kind(half_size_m=80.0, node_m=node), kind(half_size_m=half, node_m=0.05)):
        assert max(fits._cells()) + 1 <= MOST_NODES**0.5
    assert 0.05 < node < 0.085
    assert 48.0 < half <= 52.0


def test_node_spacing_suggested_in_an_error_resolves_the_furrows():
    with pytest.raises(ValueError, match=r"^node_m: 6401 x 6401 nodes are more than 4200000; set half_size_m to 51$"):
        Ridges(half_size_m=160.0, node_m=0.05).ground()


@pytest.mark.parametrize(
    ("terrain", "key"),
    [
        (Ridges(node_m=0.3), "node_m: 0.3 m is too coarse for this relief; set a value of at most 0.0938"),
        (Bumps(node_m=0.3), "node_m: 0.3 m is too coarse for this relief; set a value of at most 0.2"),
        (Ridges(depth_m=1.0), "depth_m: the slopes are steeper than 60 deg"),
        (Bumps(height_m=2.0), "height_m: the slopes are steeper than 60 deg"),
        (Bumps(count=100), "count: bump 25 of the row is at \\(77.0, -0.5\\) m, outside the field; set count to 24"),
        (Bumps(x_m=100.0), "x_m: the first bump is at \\(100.0, -0.5\\) m, outside the field; move it"),
    ],
)
def test_error_for_an_impossible_relief_names_the_key(terrain, key):
    with pytest.raises(ValueError, match="^" + key):
        terrain.ground()


# --- rectangles ----------------------------------------------------------------------------------------------------


SIZED = [kind for kind in TERRAINS if "size_m" in kind.model_fields]


def test_every_terrain_kind_not_read_from_a_file_has_size_keys():
    assert {kind for kind in TERRAINS if kind is not Heightmap} == set(SIZED)


@pytest.mark.parametrize("kind", SIZED)
@pytest.mark.parametrize("size", [(30.0, 20.0), (12.5, 40.0)])
def test_terrain_may_be_rectangular(kind, size):
    keys = {"x_m": 0.0, "y_m": 0.0, "count": 2} if kind is Bumps else {}
    terrain = kind(size_m=size, **keys)
    ground = terrain.ground()
    x_min, x_max, y_min, y_max = ground.extent
    assert (x_max - x_min, y_max - y_min) == pytest.approx(size)
    assert (x_max + x_min, y_max + y_min) == pytest.approx((0, 0), abs=1e-9)
    assert ground.heights.shape[0] != ground.heights.shape[1]
    assert (ground.covers(size[0] / 2 - 0.1, 0.0), ground.covers(0.0, size[0] / 2 + 0.1)) == (True, size[1] > size[0])
    again = TypeAdapter(Terrain).validate_json(json.dumps(terrain.model_dump(mode="json")))
    assert (again.size_m, again.half_size_m) == (size, None)
    assert ground.is_plane == (kind in (Flat, Slope))


@pytest.mark.parametrize("kind", [kind for kind in SIZED if kind is not Rough])
def test_rectangular_terrain_equals_that_part_of_a_square_terrain(kind):
    """Common areas have equal heights, except for rough ground, whose phases depend on the size."""
    keys = {"grade_deg": 5.0} if kind in TILTED else {}
    keys |= {"x_m": 1.0, "count": 3} if kind is Bumps else {}
    square, part = kind(half_size_m=15.0, **keys).ground(), kind(size_m=(30.0, 20.0), **keys).ground()
    for x, y in np.random.default_rng(1).uniform((-15, -10), (15, 10), (200, 2)).tolist():
        assert height_and_gradient(part, x, y) == pytest.approx(height_and_gradient(square, x, y), abs=1e-9)


@pytest.mark.parametrize("size", [(60.0, 30.0), (30.0, 60.0)])
def test_rough_rectangle_has_the_variance_of_its_roughness_class(size):
    """Parseval: the variance is the integral of the spectrum over the discrete wave numbers of the field."""
    ground = Rough(size_m=size, iso_class="D").ground()
    tile = ground.heights[:-1, :-1]
    rows, columns = tile.shape
    k = np.hypot(np.fft.fftfreq(rows, ground.spacing)[:, None], np.fft.fftfreq(columns, ground.spacing)[None, :])
    spectrum = plane_spectrum(k, ROUGHNESS["D"], min(HIGHEST_WAVE_NUMBER / ROLL_OFF, 0.5 / ground.spacing))
    assert tile.var() == pytest.approx(spectrum.sum() / (size[0] * size[1]), rel=0.01)


def test_terrain_side_is_rounded_up_to_a_whole_number_of_cells():
    x_min, x_max, y_min, y_max = Rough(size_m=(30.0, 20.03)).ground().extent
    assert x_max - x_min == pytest.approx(30.0)
    assert 20.03 <= y_max - y_min < 20.13
    assert y_max == -y_min


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("half_size_m = 20\nsize_m = [30, 20]", "size_m: cannot be combined with half_size_m; omit one key"),
        ("size_m = [30, -2]", r"terrain.size_m\[1\]: must be above 0"),
        ("size_m = [3000, 2]", "size_m: one side is more than 1000 times the other; lengthen the shorter side"),
        ("size_m = [30]", "terrain.size_m"),
    ],
)
def test_error_for_an_invalid_terrain_size_names_the_key(tmp_path, keys, message):
    file = tmp_path / "mine.toml"
    file.write_text(f'[terrain]\nkind = "rough"\n{keys}\n')
    with pytest.raises(ScenarioError, match=message):
        load_scenario(file)


def test_resolved_scenario_keeps_its_rectangular_terrain(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text('[path]\nkind = "line"\nlength_m = 5\n[terrain]\nkind = "flat"\nsize_m = [30, 20]\n')
    scenario = load_scenario(file)
    (tmp_path / "again.toml").write_text(scenario.to_toml())
    assert "half_size_m" not in scenario.to_toml()
    assert load_scenario(tmp_path / "again.toml").terrain == scenario.terrain
    rough = load_scenario(file, {"terrain.kind": "rough", "plant.settle_s": 0.5, "duration_s": 1})
    assert rough.terrain.size_m == (30.0, 20.0)
    log = run(rough)
    assert log.metrics["outcome"] == "completed"


def test_error_for_too_many_terrain_nodes_suggests_a_valid_rectangle():
    with pytest.raises(ValueError, match=r"set node_m to 0.076 or size_m to \[190, 52\]$"):
        Rough(size_m=(300.0, 80.0), node_m=0.05).ground()
    for fits in (Rough(size_m=(300.0, 80.0), node_m=0.076), Rough(size_m=(190.0, 52.0), node_m=0.05)):
        columns, rows = fits._cells()
        assert 0.85 * MOST_NODES < (columns + 1) * (rows + 1) <= MOST_NODES


# --- MuJoCo -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "terrain", [Rough(half_size_m=12, iso_class="E", grade_deg=4), Heightmap(grade_deg=3), Ridges(half_size_m=8)]
)
def test_mujoco_height_field_equals_the_terrain_grid(terrain):
    """Rays from above hit the ground at the height of the nodes (rows north, columns east), to float32 precision."""
    ground = terrain.ground()
    plant, _ = mujoco_plant(MagicFormula(), ground, settle_s=0.0)
    geom, hit = np.zeros(1, dtype=np.int32), np.zeros(3)
    rows, columns = ground.heights.shape
    above = float(ground.heights.max()) + 50.0
    for row, column in np.random.default_rng(3).integers(1, min(rows, columns) - 1, (30, 2)):
        x, y = ground.x0 + column * ground.spacing, ground.y0 + row * ground.spacing
        start = np.array([x, y, above])
        fall = mujoco.mj_ray(plant.model, plant.data, start, np.array([0.0, 0.0, -1.0]), None, 1, 1, geom, hit)
        assert plant.model.geom(geom[0]).name == "ground"
        assert above - fall == pytest.approx(ground.heights[row, column], abs=2e-5)
        assert height_and_gradient(ground, x, y)[0] == pytest.approx(ground.heights[row, column], abs=1e-9)


@pytest.mark.parametrize(("kind", "tyre"), TERRAINS_AND_TYRES)
def test_one_second_of_extreme_driving_gives_no_physics_warning(kind, tyre):
    keys = {"x_m": 0.5} if kind is Bumps else {}
    plant, _ = mujoco_plant(tyre, small(kind, **keys), settle_s=0.5)
    rng = np.random.default_rng(1)
    for _ in range(20):
        truth = plant.advance(Drive(*rng.uniform(0.0, 12.0, 2).tolist()))
        assert plant.trouble() is None
    assert np.isfinite(truth[:14]).all()
    assert plant.wheels()[:4].max() > 500.0
    assert plant.warnings() == 0


@pytest.mark.parametrize("terrain", [Rough(half_size_m=20, iso_class="E"), Ridges(half_size_m=20, depth_m=0.1)])
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_tractor_starts_on_all_wheels_at_any_position_of_a_terrain(terrain, yaw):
    """The tractor is placed on the plane below its wheels and settles without a jump on any relief."""
    for x in (0.0, 0.3, 0.61, 5.2):
        plant, truth = mujoco_plant(MagicFormula(), terrain, start=Reference(x, 1.0, 0.0, 0.0, yaw, 0.0))
        loads = plant.wheels()[:4]
        assert np.hypot(truth.x - x, truth.y - 1.0) < 0.35  # it may roll to the bottom of a furrow
        assert abs(truth.roll) < 0.2
        assert loads.sum() == pytest.approx(plant.tractor.mass_kg * 9.81, rel=0.1)
        assert loads.min() > 300.0


def test_slope_terrain_equals_tilted_flat_terrain():
    assert Slope(grade_deg=7.0).ground().heights == pytest.approx(Slope(grade_deg=7.0).tilt(Flat().ground()).heights)
