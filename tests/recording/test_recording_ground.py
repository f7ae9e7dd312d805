from math import tan

import numpy as np
import pytest

from agrobot_mj.recording.world.ground import FINEST_M, MARGIN_M, ground_mesh
from agrobot_mj.terrain import Ground, Slope
from agrobot_mj.terrain.grid import Surface, heights, plane

PATH = np.column_stack([np.linspace(0.0, 20.0, 50), np.zeros(50)])


class Mesh:
    """Displayed mesh: positions (n, 3), normals (n, 3), colours (n, 3) and triangles (m, 3)."""

    def __init__(self, ground, path=PATH):
        mesh = ground_mesh(ground, path)
        self.positions = np.array(mesh.vertex_positions.as_arrow_array().to_pylist())
        self.triangles = np.array(mesh.triangle_indices.as_arrow_array().to_pylist())
        packed = np.array(mesh.vertex_colors.as_arrow_array().to_pylist(), dtype=np.uint32)
        self.colours = np.stack([packed >> shift & 0xFF for shift in (24, 16, 8)], axis=-1).astype(float)
        given = mesh.vertex_normals
        self.normals = None if given is None else np.array(given.as_arrow_array().to_pylist())
        self.a, self.b, self.c = self.positions[self.triangles].transpose(1, 0, 2)

    @property
    def areas(self):
        """Areas of the triangles seen from above, positive if counter-clockwise."""
        return np.cross(self.b - self.a, self.c - self.a)[:, 2] / 2

    def colour_at(self, x, y):
        return self.colours[np.hypot(self.positions[:, 0] - x, self.positions[:, 1] - y).argmin()]


def furrows(spacing=0.05, half=30.0, depth=0.06):
    nodes = np.arange(-half, half + 1e-9, spacing)
    relief = depth * np.cos(2 * np.pi * nodes / 0.75)
    return Ground(-half, -half, spacing, np.repeat(relief[:, None], len(nodes), axis=1))


def edges_used_once(mesh):
    """Return the boundary edges of a mesh as pairs of positions. Inner edges belong to two triangles."""
    places = np.unique(mesh.positions.round(4), axis=0, return_inverse=True)
    ids = places[1].ravel()[mesh.triangles]
    pairs = np.sort(np.concatenate([ids[:, [0, 1]], ids[:, [1, 2]], ids[:, [2, 0]]]), axis=1)
    kinds, counts = np.unique(pairs, axis=0, return_counts=True)
    return places[0][kinds[counts == 1]]


def test_plane_is_drawn_as_a_coarse_checkerboard():
    mesh = Mesh(Slope(grade_deg=10, direction_deg=0, half_size_m=30).ground())
    np.testing.assert_allclose(mesh.positions[:, 2], tan(np.radians(10)) * mesh.positions[:, 0], atol=1e-5)
    assert np.abs(mesh.positions[:, :2]).max() == 30
    np.testing.assert_allclose(mesh.areas, 2.0, rtol=1e-4)  # each half a square of 2 m
    assert mesh.areas.sum() == pytest.approx(60 * 60)
    by_tile = mesh.colours[: 4 * 30 * 30].reshape(-1, 4, 3)
    steps = np.abs(by_tile[0, 0] - by_tile[1, 0])
    assert 3 < steps.max() < 30  # neighbours differ, calmly


def test_mesh_of_level_ground_has_two_colours_and_few_triangles():
    mesh = Mesh(plane(0.0, 0.0, 500.0))
    low, high = PATH.min(axis=0) - MARGIN_M + 1, PATH.max(axis=0) + MARGIN_M - 1
    near = ((mesh.a[:, :2] > low) & (mesh.a[:, :2] < high)).all(axis=1)
    assert len(np.unique(mesh.colours[mesh.triangles[near]].reshape(-1, 3), axis=0)) == 2
    assert len(np.unique(mesh.colours, axis=0)) == 3
    assert mesh.positions.max() > PATH.max() + 5 * MARGIN_M  # up to the horizon
    x, y = np.ptp(mesh.positions, axis=0)[:2]
    assert mesh.areas.min() > 0
    assert mesh.areas.sum() == pytest.approx(x * y)
    assert len(mesh.positions) < 20_000
    long = Mesh(plane(0.0, 0.0, 5000.0), np.array([[0.0, 0.0], [3000.0, 2000.0]]))
    assert len(long.positions) < 30_000


def test_furrows_near_the_path_are_drawn_in_full_detail():
    ground = furrows()
    mesh = Mesh(ground)
    near = np.abs(mesh.positions[:, 1]) < 4
    near &= (mesh.positions[:, 0] > -4) & (mesh.positions[:, 0] < 24)
    x, y, z = mesh.positions[near].T
    np.testing.assert_allclose(z, heights(ground, x, y), atol=1e-5)
    assert np.diff(np.unique(y.round(4))).max() <= FINEST_M + 1e-9
    slope = -2 * np.pi / 0.75 * 0.06 * np.sin(2 * np.pi * y / 0.75)
    np.testing.assert_allclose(mesh.normals[near, 0], 0.0, atol=1e-5)
    np.testing.assert_allclose(-mesh.normals[near, 1] / mesh.normals[near, 2], slope, atol=0.06)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, rtol=1e-5)
    crest, bottom = mesh.colours[near][z > 0.055].mean(), mesh.colours[near][z < -0.055].mean()
    assert crest > bottom + 5


def test_furrows_far_from_the_path_are_drawn_as_level_ground():
    mesh = Mesh(furrows(half=60.0), np.array([[0.0, 0.0], [1.0, 0.0]]))
    far = np.hypot(*mesh.positions[:, :2].T) > 40
    assert far.any()
    assert np.abs(mesh.positions[far, 2]).max() < 0.03


def test_ground_mesh_has_no_gaps_and_covers_the_field():
    mesh = Mesh(furrows())
    assert (mesh.areas > 0).all()
    assert mesh.areas.sum() == pytest.approx(60 * 60, rel=1e-6)
    assert len(mesh.positions) < 80_000
    # A fine tile meets a coarse one in a straight edge: what the fine side has there lies on the coarse side's edge.
    rim = edges_used_once(mesh)
    inner = rim[(np.abs(rim[..., :2]).max(axis=(1, 2)) < 29.99)]
    long = inner[np.linalg.norm(inner[:, 1] - inner[:, 0], axis=1) > 1.5]
    short = inner[np.linalg.norm(inner[:, 1] - inner[:, 0], axis=1) < 1.5]
    assert len(long)
    assert len(short) > len(long)
    for begin, end in long:
        along = (end - begin) / np.linalg.norm(end - begin)
        for point in short.reshape(-1, 3):
            share = (point - begin) @ along
            off = point - begin - share * along
            if np.hypot(*off[:2]) < 1e-6 and 0 < share < np.linalg.norm(end - begin):
                assert abs(off[2]) < 1e-3


def test_ground_patches_have_separate_colours_and_sharp_borders():
    friction, cone_index = np.ones((40, 40)), np.zeros((40, 40))
    friction[:, :20], cone_index[:, 30:] = 0.4, 3e5
    surface = Surface(0.0, -5.0, 0.25, friction, cone_index)
    mesh = Mesh(plane(0.0, 0.0, 50.0)._replace(surface=surface))
    wet, field, soft = (mesh.colour_at(x, 0.9) for x in (1.5, 6.0, 8.9))
    assert wet[2] > wet[1] > wet[0]  # bluish
    assert field[1] > field[0] > field[2]  # green
    assert soft[0] > soft[1] > soft[2]  # brown
    assert soft.sum() < field.sum()
    bluish = mesh.positions[mesh.colours[:, 2] > mesh.colours[:, 0]]
    assert bluish[:, 0].min() == pytest.approx(0.0, abs=0.26)
    assert bluish[:, 0].max() == pytest.approx(5.0, abs=0.26)


def test_colours_blend_smoothly_at_ground_patch_borders():
    """Along an oblique border, the colours change as along a straight border, so that no grid cells are visible."""
    cells = (np.arange(160) + 0.5) * 0.25 - 20
    x, y = np.meshgrid(cells, cells)
    surface = Surface(-20.0, -20.0, 0.25, np.where(x + 0.5 * y < 0, 0.4, 1.0), np.zeros((160, 160)))
    mesh = Mesh(
        plane(0.0, 0.0, 50.0)._replace(surface=surface), np.column_stack([np.linspace(-5, 5, 30), np.zeros(30)])
    )
    near = (np.abs(mesh.positions[:, :2]) < 4).all(axis=1)
    across = (mesh.positions[near, 0] + 0.5 * mesh.positions[near, 1]) / np.hypot(1, 0.5)
    blue = mesh.colours[near, 2] / mesh.colours[near, 1]
    between = (blue > blue.min() * 1.05) & (blue < blue.max() * 0.95)
    assert between.sum() > 20
    assert np.abs(across[between]).max() < 0.6
    assert np.corrcoef(across[between], blue[between])[0, 1] < -0.9


def test_slopes_are_shaded_and_furrow_mesh_is_fine_only_across_furrows():
    facing, averted = (Mesh(Slope(grade_deg=12, direction_deg=d, half_size_m=30).ground()) for d in (-45, 135))
    assert facing.colours.mean() > 1.1 * averted.colours.mean(), "light from the north-west"
    mesh = Mesh(furrows())
    near = (np.abs(mesh.positions[:, 0] - 10) < 4) & (np.abs(mesh.positions[:, 1]) < 4)
    assert len(np.unique(mesh.positions[near, 1].round(3))) > 8 * len(np.unique(mesh.positions[near, 0].round(3)))
