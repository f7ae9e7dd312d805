"""What every terrain must be, and that MuJoCo's height field is the grid that the tyres read."""

from math import radians, tan

import mujoco
import numpy as np
import pytest

from agrobot_mj.core.signals import Drive, Reference
from agrobot_mj.core.spec import every
from agrobot_mj.studies.validation.base import mujoco_plant, warnings
from agrobot_mj.terrain import Bumps, Flat, Heightmap, Ridges, Rough, Slope, Terrain, height_and_gradient, surface_at
from agrobot_mj.terrain.generated import Generated
from agrobot_mj.terrain.grid import MOST_NODES
from agrobot_mj.terrain.shapes import CirclePatch
from agrobot_mj.tyres import Contact, MagicFormula

TERRAINS = every(Terrain)
GENERATED = [terrain for terrain in TERRAINS if issubclass(terrain, Generated)]
TILTED = [terrain for terrain in TERRAINS if "grade_deg" in terrain.model_fields]
SMALL = {"half_size_m": 10.0}


def small(kind, **keys):
    """A small field of a kind, as far as its size can be chosen."""
    size = SMALL if "half_size_m" in kind.model_fields else {}
    return kind(**size | ({"count": 2} if kind is Bumps else {}) | keys)


@pytest.mark.parametrize("kind", TERRAINS)
def test_a_grid_is_finite_square_and_about_the_origin(kind):
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
def test_a_terrain_is_the_same_every_time(kind):
    first = kind().relief().heights
    assert np.array_equal(first, kind().relief().heights)


@pytest.mark.parametrize("kind", [kind for kind in TERRAINS if "seed" in kind.model_fields])
def test_the_seed_makes_another_field_of_the_same_sort(kind):
    keys = {"layout": "scattered", "count": 40} if kind is Bumps else {}
    one, other = (small(kind, **{**keys, "seed": seed}).ground().heights for seed in (1, 2))
    assert not np.allclose(one, other, atol=1e-3)
    assert one.std() == pytest.approx(other.std(), rel=0.4)


@pytest.mark.parametrize("kind", TERRAINS)
def test_patches_lie_on_every_terrain(kind):
    surface = small(kind, patch=(CirclePatch(radius_m=2.0, friction=0.5),)).ground().surface
    assert surface_at(surface, 0.5, 0.5)[0] == 0.5
    assert surface_at(surface, 3.0, 3.0)[0] == 1.0


@pytest.mark.parametrize("kind", TILTED)
def test_a_tilted_relief_is_the_level_one_on_a_plane(kind):
    level, tilted = (small(kind, grade_deg=grade, direction_deg=30.0).ground() for grade in (0.0, 12.0))
    rows, columns = level.heights.shape
    x = level.x0 + level.spacing * np.arange(columns)
    y = level.y0 + level.spacing * np.arange(rows)
    rise = tan(radians(12.0)) * (np.cos(radians(30.0)) * x[None, :] + np.sin(radians(30.0)) * y[:, None])
    assert tilted.heights - level.heights == pytest.approx(rise, abs=1e-9)


@pytest.mark.parametrize("kind", GENERATED)
def test_the_run_in_is_level_and_fades(kind):
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
def test_too_many_nodes_are_refused_with_values_that_fit(kind):
    with pytest.raises(
        ValueError, match=r"^node_m: 3201 x 3201 nodes are more than 4200000; set node_m to .*"
    ) as error:
        kind(half_size_m=80.0, node_m=0.05).ground()
    node, half = (float(part.split()[0]) for part in str(error.value).partition("set ")[2].split(" to ")[1:])
    assert kind(half_size_m=80.0, node_m=node)._cells() + 1 <= MOST_NODES**0.5
    assert kind(half_size_m=half, node_m=0.05)._cells() + 1 <= MOST_NODES**0.5
    assert 0.05 < node < 0.085
    assert 48.0 < half <= 52.0


def test_no_spacing_of_nodes_is_offered_that_misses_the_furrows():
    with pytest.raises(ValueError, match=r"^node_m: 6401 x 6401 nodes are more than 4200000; set half_size_m to 51$"):
        Ridges(half_size_m=160.0, node_m=0.05).ground()


@pytest.mark.parametrize(
    ("terrain", "key"),
    [
        (Ridges(node_m=0.3), "node_m: 0.3 m is too coarse for this relief; set at most 0.0938"),
        (Bumps(node_m=0.3), "node_m: 0.3 m is too coarse for this relief; set at most 0.2"),
        (Ridges(depth_m=1.0), "depth_m: makes flanks steeper than 60 deg"),
        (Bumps(height_m=2.0), "height_m: makes flanks steeper than 60 deg"),
        (Bumps(count=100), "count: bump 25 of the row lies at \\(77.0, -0.5\\) m, outside the field; set count to 24"),
        (Bumps(x_m=100.0), "x_m: the first bump lies at \\(100.0, -0.5\\) m, outside the field; move it"),
    ],
)
def test_what_makes_no_relief_is_told_by_key(terrain, key):
    with pytest.raises(ValueError, match="^" + key):
        terrain.ground()


# --- MuJoCo -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "terrain", [Rough(half_size_m=12, iso_class="E", grade_deg=4), Heightmap(grade_deg=3), Ridges(half_size_m=8)]
)
def test_mujocos_height_field_is_the_grid(terrain):
    """Rays from above hit the ground at the height of the nodes, rows north and columns east, within its float32."""
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


@pytest.mark.parametrize("tyre", [MagicFormula(), Contact()], ids=lambda tyre: tyre.kind)
@pytest.mark.parametrize("kind", TERRAINS)
def test_a_second_of_wild_driving_gives_no_warning(kind, tyre):
    keys = {"x_m": 0.5} if kind is Bumps else {}
    plant, _ = mujoco_plant(tyre, small(kind, **keys), settle_s=0.5)
    rng = np.random.default_rng(1)
    for _ in range(20):
        truth = plant.advance(Drive(*rng.uniform(0.0, 12.0, 2).tolist()))
        assert plant.trouble() is None
    assert np.isfinite(truth[:14]).all()
    assert plant.wheels()[:4].max() > 500.0
    assert warnings([plant]) == 0


@pytest.mark.parametrize("terrain", [Rough(half_size_m=20, iso_class="E"), Ridges(half_size_m=20, depth_m=0.1)])
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_the_tractor_starts_on_its_wheels_wherever_it_stands(terrain, yaw):
    """Placed on the plane below its wheels, it settles without a jump on whatever relief is there."""
    for x in (0.0, 0.3, 0.61, 5.2):
        plant, truth = mujoco_plant(MagicFormula(), terrain, start=Reference(x, 1.0, 0.0, 0.0, yaw, 0.0))
        loads = plant.wheels()[:4]
        assert np.hypot(truth.x - x, truth.y - 1.0) < 0.35  # it may roll to the bottom of a furrow
        assert abs(truth.roll) < 0.2
        assert loads.sum() == pytest.approx(plant.tractor.mass_kg * 9.81, rel=0.1)
        assert loads.min() > 300.0


def test_level_and_tilted_kinds_agree():
    assert Slope(grade_deg=7.0).ground().heights == pytest.approx(Slope(grade_deg=7.0).tilted(Flat().ground()).heights)
