"""Ground mesh of dark and light tiles, which make motion visible. The mesh is finer at relief and patch borders.

Coarse tiles cover the field around the path. Tiles with relief or at the border of soil patches are subdivided, nearest
to the path first, up to a maximum number of vertices. Relief is coloured by height and shaded with light from the
north-west. Soft soil is brown, slippery ground is bluish.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr

from agrobot_mj.core.signals import Array
from agrobot_mj.recording.transport.timeline import Index
from agrobot_mj.recording.world.colours import by_height, by_soil
from agrobot_mj.terrain import Ground
from agrobot_mj.terrain.grid import Surface, heights

Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
MARGIN_M = 50.0  # Width of the ground drawn around the path [m]. A tractor farther away has diverged.
APRON_M, APRON_STEPS = 400.0, 8
"""Width [m] of the apron, which is the surface around the tiles, and number of its segments per side [-]."""
TILE_M = 2.0  # Side length of a tile [m]. Fields that would need more than `MOST_TILES` have larger tiles.
MOST_TILES = 6_000
MOST_VERTICES = 60_000
"""Maximum number of vertices of subdivided tiles. A vertex requires 52 bytes, including normal and triangles."""
FINEST_M = 0.1  # Minimum distance between vertices on relief [m]: about 7 per furrow of 0.75 m
SMOOTH_M = 0.004
"""Maximum deviation of the relief in a tile from straight lines along x or y [m]. A tile with a smaller deviation is
not subdivided along this axis."""
BORDER_M = 0.25  # Distance between vertices at borders of patches [m]
BLEND_M = 0.35  # Half width of the strip in which the colours of two patches are blended, to avoid jagged borders [m]
CORRIDOR_M = 4.0
"""Distance from the path within which all tiles with relief are subdivided, if necessary with fewer segments [m]."""
DIVIDED_M = 25.0  # Distance from the path above which relief is omitted, because relief flickers in distant views [m]
ROUGH_LIFT_M = 0.02  # Maximum height of the corners of mesh triangles above relief [m]
SHADES = 0.96, 1.04  # Brightness factors of the two shades of tiles [-]
SUN = np.array([-0.45, 0.45, 0.77])
"""Direction to the light source (east, north, up): north-west, elevation 50 deg."""
DARKEST, BRIGHTEST = 0.55, 1.45  # Minimum and maximum brightness factor after shading [-]


Steps = tuple[int, int]  # Number of segments of a tile in x and y


class _Field(NamedTuple):
    """Grid of `columns` x `rows` tiles of size (width, height), with its south-west corner at (x0, y0) [m]."""

    x0: float
    y0: float
    width: float
    height: float
    columns: int
    rows: int

    def points(self, tiles: Index, steps: Steps, beyond: float = 0.0) -> tuple[Array, Array]:
        """Return the x and y coordinates of the mesh nodes of `tiles`, each of shape (n, steps[1] + 1, steps[0] + 1)
        [m].

        `tiles` (n, 2) are row and column indices. Each tile is divided into `steps` segments (in x, in y) and extended
        by `beyond` [m] on each side.
        """
        u, v = (np.arange(count + 1) / count for count in steps)
        u, v = u + (2 * u - 1) * beyond / self.width, v + (2 * v - 1) * beyond / self.height
        x = self.x0 + self.width * (tiles[:, 1, None, None] + u[None, None, :])
        y = self.y0 + self.height * (tiles[:, 0, None, None] + v[None, :, None])
        shape = (len(tiles), len(v), len(u))
        return np.broadcast_to(x, shape).copy(), np.broadcast_to(y, shape).copy()

    def corners(self) -> tuple[Array, Array]:
        """Return the x and y coordinates of all tile corners, each of shape (rows + 1, columns + 1) [m]."""
        x, y = self.x0 + self.width * np.arange(self.columns + 1), self.y0 + self.height * np.arange(self.rows + 1)
        return np.meshgrid(x, y)


def on_ground(ground: Ground, points: Array, lift: float) -> Array:
    """Return points (n, 2) at the height `lift` [m] above the ground, shape (n, 3) [m].

    On relief, the points are also above the ground mesh.
    """
    lift += 0.0 if ground.is_plane else ROUGH_LIFT_M
    return np.column_stack([points, heights(ground, points[:, 0], points[:, 1]) + lift])


def slopes(ground: Ground, x: Array, y: Array, reach: float) -> tuple[Array, Array]:
    """Return the slopes dh/dx and dh/dy of the ground height h at `x` and `y` [m], by differences over +-`reach`
    [m]."""
    dx = heights(ground, x + reach, y) - heights(ground, x - reach, y)
    dy = heights(ground, x, y + reach) - heights(ground, x, y - reach)
    return dx / (2 * reach), dy / (2 * reach)


def ground_mesh(ground: Ground, path: Array) -> rr.Mesh3D:
    """Return the ground mesh around the points `path` (n, 2) [m]."""
    field = _field(ground, path)
    fine, steps = _tiles_to_divide(ground, field, path)
    corners = _corners(ground, field, fine)
    tilts = np.gradient(corners, field.height, field.width)
    parts = [_coarse(field, fine, corners, tilts)]
    if fine.any():
        parts.append(_fine(ground, field, fine, corners, steps))
    level = np.concatenate([part.positions[:, 2] for part in parts])
    if ground.is_plane:
        parts.append(_apron(ground, field))
    starts = np.cumsum([0, *(len(part.positions) for part in parts[:-1])])
    positions = np.concatenate([part.positions for part in parts])
    triangles = np.concatenate([start + part.triangles for part, start in zip(parts, starts, strict=True)])
    return rr.Mesh3D(
        vertex_positions=positions.astype(np.float32),
        triangle_indices=triangles.astype(np.uint32),
        vertex_normals=None if ground.is_plane else np.concatenate([part.normals for part in parts]),
        vertex_colors=_vertex_colours(ground, parts, level),
    )


def smooth_corners(ground: Ground, path: Array) -> Array:
    """Return the tile corners around `path` (n, 2) [m] with mean ground heights, shape (rows + 1, columns + 1, 3)
    [m]."""
    field = _field(ground, path)
    if ground.is_plane:
        field = _Field(field.x0, field.y0, field.width * field.columns, field.height * field.rows, 1, 1)
    x, y = field.corners()
    return np.stack([x, y, heights(ground, x, y) if ground.is_plane else _mean(ground, field)], axis=-1)


class _Part(NamedTuple):
    """Part of the ground mesh: vertices and triangles."""

    positions: Array  # Positions of the vertices [m], shape (n, 3)
    normals: Array  # Normals of the vertices, shape (n, 3)
    shade: Array  # Shade of each vertex from 0 (dark tile) to 1 (light tile), shape (n,)
    triangles: Index  # Vertex indices of the triangles, counter-clockwise seen from above, shape (m, 3)


def _field(ground: Ground, path: Array) -> _Field:
    x_min, x_max, y_min, y_max = ground.extent
    (x0, y0), (x1, y1) = path.min(axis=0) - MARGIN_M, path.max(axis=0) + MARGIN_M
    x0, x1, y0, y1 = max(x0, x_min), min(x1, x_max), max(y0, y_min), min(y1, y_max)
    side = max(TILE_M, ((x1 - x0) * (y1 - y0) / MOST_TILES) ** 0.5)
    columns, rows = max(1, round((x1 - x0) / side)), max(1, round((y1 - y0) / side))
    return _Field(x0, y0, (x1 - x0) / columns, (y1 - y0) / rows, columns, rows)


def _tiles_to_divide(ground: Ground, field: _Field, path: Array) -> tuple[Mask, Steps]:
    """Return a mask (rows, columns) of the tiles to subdivide, and the number of segments of these tiles in x and y."""
    if ground.is_plane and not ground.surface.friction.size:
        return np.zeros((field.rows, field.columns), dtype=bool), (1, 1)
    from scipy.spatial import cKDTree  # slow import (0.2 s), needed only for uneven ground

    tiles = np.indices((field.rows, field.columns)).reshape(2, -1).T
    x, y = field.points(tiles, (1, 1))
    middles = np.column_stack([x.mean(axis=(1, 2)), y.mean(axis=(1, 2))])
    away = cKDTree(path).query(middles)[0]
    side = max(field.width, field.height)
    if ground.is_plane:
        wanted, finest = _border_tiles(ground.surface, field, tiles), max(BORDER_M, ground.surface.spacing)
    else:
        wanted, finest = away < DIVIDED_M, max(FINEST_M, ground.spacing)
    near = wanted & (away < CORRIDOR_M + side)
    most = int(np.ceil(side / finest - 1e-9))
    straight = _straight(ground, field, tiles[near], most)
    if all(straight):
        return np.zeros((field.rows, field.columns), dtype=bool), (1, 1)
    varied = 2 - sum(straight)  # number of directions that need vertices
    room = MOST_VERTICES / max(int(near.sum()), 1) / 2 ** sum(straight)
    count = int(np.clip(room ** (1 / max(varied, 1)) - 1, 1, most))
    steps = 1 if straight[0] else count, 1 if straight[1] else count
    # A limit on the distance gives the subdivided area a straight border.
    ordered, budget = np.sort(away[wanted]), MOST_VERTICES // ((steps[0] + 1) * (steps[1] + 1))
    farthest = ordered[budget] if budget < len(ordered) else np.inf
    fine = wanted & (away < farthest - 1e-6) & (max(steps) > 1)
    return fine.reshape(field.rows, field.columns), steps


def _straight(ground: Ground, field: _Field, tiles: Index, most: int) -> tuple[bool, bool]:
    """Return whether the relief of `tiles` (n, 2) is straight along x, and whether it is straight along y. Furrows are
    often straight along one axis."""
    if ground.is_plane or not len(tiles):
        return False, False
    z = heights(ground, *field.points(tiles[:: max(1, len(tiles) // 100)], (most, most)))
    u = np.arange(most + 1) / most
    along_x = z[:, :, :1] * (1 - u) + z[:, :, -1:] * u
    along_y = z[:, :1] * (1 - u[:, None]) + z[:, -1:] * u[:, None]
    return bool(np.abs(z - along_x).max() < SMOOTH_M), bool(np.abs(z - along_y).max() < SMOOTH_M)


def _border_tiles(surface: Surface, field: _Field, tiles: Index) -> Mask:
    """Return a mask (n,) of the `tiles` (n, 2) that contain several soil types, including a margin for blending
    colours."""
    friction, cone_index = properties(surface, *field.points(tiles, (9, 9), BLEND_M))
    found: Mask = (np.ptp(friction, axis=(1, 2)) > 0) | (np.ptp(cone_index, axis=(1, 2)) > 0)
    return found


def _corners(ground: Ground, field: _Field, fine: Mask) -> Array:
    """Return the heights of all tile corners [m], shape (rows + 1, columns + 1). Corners of coarse tiles have mean
    heights."""
    exact = heights(ground, *field.corners())
    if not fine.any() or ground.is_plane:
        return exact
    around = np.pad(fine, 1)
    inside = around[:-1, :-1] & around[1:, :-1] & around[:-1, 1:] & around[1:, 1:]
    return np.where(inside, exact, _mean(ground, field))


def _mean(ground: Ground, field: _Field) -> Array:
    """Return the mean height of a tile-sized area around each tile corner [m], shape (rows + 1, columns + 1)."""
    x, y = field.corners()
    offsets = (np.arange(6) + 0.5) / 6 - 0.5
    around = [heights(ground, x + a * field.width, y + b * field.height) for a in offsets for b in offsets]
    found: Array = np.mean(around, axis=0)
    return found


def _coarse(field: _Field, fine: Mask, corners: Array, tilts: tuple[Array, Array]) -> _Part:
    tiles = np.argwhere(~fine)
    x, y = field.points(tiles, (1, 1))
    j, i = (tiles[:, k, None, None] for k in (0, 1))
    nodes = j + np.arange(2)[None, :, None], i + np.arange(2)[None, None, :]
    return _part((x, y, corners[nodes]), (tilts[1][nodes], tilts[0][nodes]), tiles.sum(axis=1) % 2)


def _fine(ground: Ground, field: _Field, fine: Mask, corners: Array, steps: Steps) -> _Part:
    """Return the mesh of the subdivided tiles. Edges next to coarse tiles are straight, so that the mesh has no
    gaps."""
    tiles = np.argwhere(fine)
    x, y = field.points(tiles, steps)
    z = heights(ground, x, y)
    j, i = tiles.T
    around = np.pad(fine, 1)
    for a in (0, 1):
        for b in (0, 1):
            z[:, -a, -b] = corners[j + a, i + b]
    for edge, beside in (
        (np.s_[:, 0, :], around[j, i + 1]),
        (np.s_[:, -1, :], around[j + 2, i + 1]),
        (np.s_[:, :, 0], around[j + 1, i]),
        (np.s_[:, :, -1], around[j + 1, i + 2]),
    ):
        line = z[edge]
        u = np.linspace(0.0, 1.0, line.shape[1])
        straight = line[:, :1] * (1 - u) + line[:, -1:] * u
        z[edge] = np.where(beside[:, None], line, straight)
    reach = max(min(field.width / steps[0], field.height / steps[1]), ground.spacing) / 2
    # The shading makes relief visible. Tiles of two shades would hide it.
    squares = tiles.sum(axis=1) % 2 if ground.is_plane else np.full(len(tiles), 0.5)
    return _part((x, y, z), slopes(ground, x, y, reach), squares)


def _part(nodes: tuple[Array, Array, Array], tilts: tuple[Array, Array], squares: Array) -> _Part:
    """Return the mesh part of n tiles. `nodes` (x, y, z) [m] and slopes `tilts` have shape (n, rows, columns);
    `squares` (n,) is the shade of each tile."""
    count, rows, columns = nodes[0].shape
    normals = np.stack([-tilts[0], -tilts[1], np.ones(nodes[0].shape)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    firsts = rows * columns * np.arange(count)
    triangles = firsts[:, None, None] + grid_triangles(rows - 1, columns - 1).reshape(-1, 3)
    points = np.stack(nodes, axis=-1).reshape(-1, 3)
    shade = np.repeat(squares.astype(float), rows * columns)
    return _Part(points, normals.reshape(-1, 3).astype(np.float32), shade, triangles.reshape(-1, 3))


def _apron(ground: Ground, field: _Field) -> _Part:
    x_min, x_max, y_min, y_max = ground.extent
    x1, y1 = field.x0 + field.columns * field.width, field.y0 + field.rows * field.height
    across = [max(x_min, field.x0 - APRON_M), *np.linspace(field.x0, x1, APRON_STEPS + 1), min(x_max, x1 + APRON_M)]
    along = [max(y_min, field.y0 - APRON_M), *np.linspace(field.y0, y1, APRON_STEPS + 1), min(y_max, y1 + APRON_M)]
    x, y = np.meshgrid(across, along)
    around = np.outer(np.diff(along) > 1e-6, np.diff(across) > 1e-6)
    around[1:-1, 1:-1] = False
    positions = np.stack([x, y, heights(ground, x, y)], axis=-1).reshape(-1, 3)
    triangles = grid_triangles(APRON_STEPS + 2, APRON_STEPS + 2)[around].reshape(-1, 3)
    dx, dy = slopes(ground, np.full(1, field.x0), np.full(1, field.y0), 1.0)
    normal = np.array([-dx[0], -dy[0], 1.0]) / np.sqrt(1 + dx[0] ** 2 + dy[0] ** 2)
    return _Part(positions, np.tile(normal, (len(positions), 1)), np.full(len(positions), 0.5), triangles)


def grid_triangles(rows: int, columns: int) -> Index:
    """Return the vertex indices of the two triangles in each grid cell, shape (rows, columns, 2, 3)."""
    width = columns + 1
    corner = width * np.arange(rows)[:, None] + np.arange(columns)
    found: Index = corner[..., None, None] + np.array([[0, 1, width + 1], [0, width + 1, width]])
    return found


def properties(surface: Surface, x: Array, y: Array) -> tuple[Array, Array]:
    """Return the friction scale [-] and cone index [Pa] at `x` and `y` [m]. Unspecified cone indices are 0."""
    rows, columns = surface.friction.shape
    i, j = (np.floor((v - v0) / surface.spacing).astype(int) for v, v0 in ((x, surface.x0), (y, surface.y0)))
    there = (i >= 0) & (i < columns) & (j >= 0) & (j < rows)
    friction, cone_index = (np.full(x.shape, value) for value in surface.elsewhere[:2])
    friction[there], cone_index[there] = (a[j[there], i[there]] for a in (surface.friction, surface.cone_index))
    return friction, cone_index


def _vertex_colours(ground: Ground, parts: Sequence[_Part], level: Array) -> Array:
    """Return the vertex colours (n, 3), uint8. The colour ramp spans the range of the heights `level` [m]."""
    positions, shade = np.concatenate([part.positions for part in parts]), np.concatenate([p.shade for p in parts])
    colours = by_height(positions[:, 2], float(level.min()), float(level.max()))
    if ground.surface.friction.size:
        colours = _blend_colours(ground.surface, colours, positions)
    normals = np.concatenate([part.normals for part in parts])
    lit = np.clip(normals @ SUN / SUN[2], DARKEST, BRIGHTEST)
    dark, light = SHADES
    factor = lit / np.sqrt(np.median(lit)) * (dark + (light - dark) * shade)  # the median brightness is adjusted
    found: Array = np.clip(colours * factor[:, None], 0, 255).astype(np.uint8)
    return found


def _blend_colours(surface: Surface, colours: Array, positions: Array) -> Array:
    """Return `colours` (n, 3) blended with the mean soil colours within `BLEND_M` of the `positions` (n, 3) [m]."""
    offsets = BLEND_M * np.array([-0.75, -0.25, 0.25, 0.75])
    x, y = positions[:, 0], positions[:, 1]
    painted = [by_soil(colours, *properties(surface, x + a, y + b)) for a in offsets for b in offsets]
    found: Array = np.mean(painted, axis=0)
    return found
