"""The ground as a mesh: squares of two shades that make motion visible, finer where there is something to see.

Coarse tiles cover the field around the path. Those that need it, near the path first and as many as the budget allows,
are divided: where the ground is no plane, and along the borders of patches. Relief is coloured by height, soft soil
brown, slippery ground bluish.
"""

from typing import NamedTuple

import numpy as np
import rerun as rr
from scipy.spatial import cKDTree

from agrobot_mj.core.signals import Array
from agrobot_mj.recording.transport.timeline import Index
from agrobot_mj.recording.world.colours import by_height, by_soil
from agrobot_mj.terrain import Ground
from agrobot_mj.terrain.grid import Surface, heights

Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
MARGIN_M = 50.0
"""Ground drawn around the path; a tractor farther off has diverged [m]."""
APRON_M, APRON_STEPS = 400.0, 8
"""Around the tiles of a plane, and its parts along each side."""
TILE_M = 2.0
"""Side of a tile; larger on fields that would need more than `MOST_TILES` [m]."""
MOST_TILES = 6_000
MOST_VERTICES = 60_000
"""Of divided tiles: 52 bytes each with normals and triangles."""
FINEST_M = 0.15
"""Between vertices on relief: five a furrow of 0.75 m [m]."""
BORDER_M = 0.25
"""The same along the borders of patches [m]."""
CORRIDOR_M = 4.0
"""As far from the path tiles are divided in any case, if more coarsely [m]."""
ROUGH_LIFT_M = 0.02
"""The mesh cuts the corners of relief by less than this [m]."""
SHADES = 0.96, 1.04
"""Of the two kinds of squares."""


class _Field(NamedTuple):
    """The tiles: `columns` x `rows` of size (width, height) from (x0, y0) on [m]."""

    x0: float
    y0: float
    width: float
    height: float
    columns: int
    rows: int

    def points(self, tiles: Index, steps: int) -> tuple[Array, Array]:
        """Nodes of `tiles` (n, 2), row and column, divided into `steps` each way: x, y (n, steps + 1, steps + 1)."""
        u = np.arange(steps + 1) / steps
        x = self.x0 + self.width * (tiles[:, 1, None, None] + u[None, None, :])
        y = self.y0 + self.height * (tiles[:, 0, None, None] + u[None, :, None])
        shape = (len(tiles), steps + 1, steps + 1)
        return np.broadcast_to(x, shape).copy(), np.broadcast_to(y, shape).copy()


def on_ground(ground: Ground, points: Array, lift: float) -> Array:
    """Points (n, 2) laid `lift` above the ground, shape (n, 3) [m]; above the corners of the mesh on relief."""
    lift += 0.0 if ground.is_plane else ROUGH_LIFT_M
    return np.column_stack([points, heights(ground, points[:, 0], points[:, 1]) + lift])


def slopes(ground: Ground, x: Array, y: Array, reach: float) -> tuple[Array, Array]:
    """dh/dx and dh/dy [-] between points `reach` [m] to either side, shape as `x` and `y` [m]."""
    dx = heights(ground, x + reach, y) - heights(ground, x - reach, y)
    dy = heights(ground, x, y + reach) - heights(ground, x, y - reach)
    return dx / (2 * reach), dy / (2 * reach)


def ground_mesh(ground: Ground, path: Array) -> rr.Mesh3D:
    """The ground around `path` (n, 2), as far as there is any."""
    field = _field(ground, path)
    fine, steps = _divided(ground, field, path)
    corners = _corners(ground, field, fine)
    tilts = np.gradient(corners, field.height, field.width)
    parts = [_coarse(ground, field, fine, corners, tilts)]
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
        vertex_colors=_painted(ground, positions, np.concatenate([part.tiles for part in parts]), level),
    )


class _Part(NamedTuple):
    """Vertices and the triangles between them."""

    positions: Array
    """Shape (n, 3) [m]."""
    normals: Array
    """Shape (n, 3)."""
    tiles: Array
    """Each vertex's tile: its centre [m] and its shade, 0 dark to 1 light, shape (n, 3)."""
    triangles: Index
    """Counter-clockwise from above, shape (m, 3)."""


def _field(ground: Ground, path: Array) -> _Field:
    x_min, x_max, y_min, y_max = ground.extent
    (x0, y0), (x1, y1) = path.min(axis=0) - MARGIN_M, path.max(axis=0) + MARGIN_M
    x0, x1, y0, y1 = max(x0, x_min), min(x1, x_max), max(y0, y_min), min(y1, y_max)
    side = max(TILE_M, ((x1 - x0) * (y1 - y0) / MOST_TILES) ** 0.5)
    columns, rows = max(1, round((x1 - x0) / side)), max(1, round((y1 - y0) / side))
    return _Field(x0, y0, (x1 - x0) / columns, (y1 - y0) / rows, columns, rows)


def _divided(ground: Ground, field: _Field, path: Array) -> tuple[Mask, int]:
    """Which tiles are divided, shape (rows, columns), and into how many steps each way."""
    if ground.is_plane and not ground.surface.friction.size:
        return np.zeros((field.rows, field.columns), dtype=bool), 1
    tiles = np.indices((field.rows, field.columns)).reshape(2, -1).T
    x, y = field.points(tiles, 1)
    middles = np.column_stack([x.mean(axis=(1, 2)), y.mean(axis=(1, 2))])
    away = cKDTree(path).query(middles)[0]
    side = max(field.width, field.height)
    if ground.is_plane:
        wanted, finest = _bordered(ground.surface, field, tiles), max(BORDER_M, ground.surface.spacing)
    else:
        wanted, finest = np.ones(len(tiles), dtype=bool), max(FINEST_M, ground.spacing)
    near = int((wanted & (away < CORRIDOR_M + side)).sum())
    steps = int(np.clip((MOST_VERTICES / max(near, 1)) ** 0.5 - 1, 1, np.ceil(side / finest - 1e-9)))
    chosen = np.argsort(np.where(wanted, away, np.inf))[: min(int(wanted.sum()), MOST_VERTICES // (steps + 1) ** 2)]
    fine = np.zeros(len(tiles), dtype=bool)
    fine[chosen if steps > 1 else []] = True
    return fine.reshape(field.rows, field.columns), steps


def _bordered(surface: Surface, field: _Field, tiles: Index) -> Mask:
    """Which of `tiles` (n, 2) hold more than one kind of ground."""
    friction, cone_index = properties(surface, *field.points(tiles, 7))
    found: Mask = (np.ptp(friction, axis=(1, 2)) > 0) | (np.ptp(cone_index, axis=(1, 2)) > 0)
    return found


def _corners(ground: Ground, field: _Field, fine: Mask) -> Array:
    """Heights of the corners of all tiles, (rows + 1, columns + 1) [m]: the mean about them beside a coarse tile."""
    x, y = np.meshgrid(
        field.x0 + field.width * np.arange(field.columns + 1), field.y0 + field.height * np.arange(field.rows + 1)
    )
    exact = heights(ground, x, y)
    if not fine.any() or ground.is_plane:
        return exact
    offsets = (np.arange(6) + 0.5) / 6 - 0.5
    mean = np.mean(
        [heights(ground, x + a * field.width, y + b * field.height) for a in offsets for b in offsets], axis=0
    )
    around = np.pad(fine, 1)
    inside = around[:-1, :-1] & around[1:, :-1] & around[:-1, 1:] & around[1:, 1:]
    return np.where(inside, exact, mean)


def _coarse(ground: Ground, field: _Field, fine: Mask, corners: Array, tilts: tuple[Array, Array]) -> _Part:
    tiles = np.argwhere(~fine)
    x, y = field.points(tiles, 1)
    j, i = (tiles[:, k, None, None] for k in (0, 1))
    nodes = j + np.arange(2)[None, :, None], i + np.arange(2)[None, None, :]
    return _part(field, tiles, (x, y, corners[nodes]), (tilts[1][nodes], tilts[0][nodes]))


def _fine(ground: Ground, field: _Field, fine: Mask, corners: Array, steps: int) -> _Part:
    """Divided tiles; where one meets a coarse tile its edge is straight, so that there is no gap."""
    tiles = np.argwhere(fine)
    x, y = field.points(tiles, steps)
    z = heights(ground, x, y)
    u = np.arange(steps + 1) / steps
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
        straight = line[:, :1] * (1 - u) + line[:, -1:] * u
        z[edge] = np.where(beside[:, None], line, straight)
    reach = max(field.width / steps, ground.spacing) / 2
    return _part(field, tiles, (x, y, z), slopes(ground, x, y, reach))


def _part(field: _Field, tiles: Index, nodes: tuple[Array, Array, Array], tilts: tuple[Array, Array]) -> _Part:
    x, y, _ = nodes
    normals = np.stack([-tilts[0], -tilts[1], np.ones(x.shape)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    middle = np.stack([x.mean(axis=(1, 2)), y.mean(axis=(1, 2)), tiles.sum(axis=1) % 2], axis=-1)
    whose = np.broadcast_to(middle[:, None, None, :], (*x.shape, 3))
    side = x.shape[1]
    firsts = side**2 * np.arange(len(tiles))
    triangles = firsts[:, None, None] + _cells(side - 1, side - 1).reshape(-1, 3)
    points = np.stack(nodes, axis=-1).reshape(-1, 3)
    return _Part(points, normals.reshape(-1, 3).astype(np.float32), whose.reshape(-1, 3), triangles.reshape(-1, 3))


def _apron(ground: Ground, field: _Field) -> _Part:
    """A plane goes on around the tiles, without squares, as far as there is any."""
    x_min, x_max, y_min, y_max = ground.extent
    x1, y1 = field.x0 + field.columns * field.width, field.y0 + field.rows * field.height
    across = [max(x_min, field.x0 - APRON_M), *np.linspace(field.x0, x1, APRON_STEPS + 1), min(x_max, x1 + APRON_M)]
    along = [max(y_min, field.y0 - APRON_M), *np.linspace(field.y0, y1, APRON_STEPS + 1), min(y_max, y1 + APRON_M)]
    x, y = np.meshgrid(across, along)
    around = np.outer(np.diff(along) > 1e-6, np.diff(across) > 1e-6)
    around[1:-1, 1:-1] = False
    positions = np.stack([x, y, heights(ground, x, y)], axis=-1).reshape(-1, 3)
    whose = np.column_stack([positions[:, :2], np.full(len(positions), 0.5)])
    triangles = _cells(APRON_STEPS + 2, APRON_STEPS + 2)[around].reshape(-1, 3)
    return _Part(positions, np.zeros(positions.shape), whose, triangles)


def _cells(rows: int, columns: int) -> Index:
    """Two triangles for each cell of a grid of nodes numbered row by row, shape (rows, columns, 2, 3)."""
    width = columns + 1
    corner = width * np.arange(rows)[:, None] + np.arange(columns)
    found: Index = corner[..., None, None] + np.array([[0, 1, width + 1], [0, width + 1, width]])
    return found


def properties(surface: Surface, x: Array, y: Array) -> tuple[Array, Array]:
    """Scale of the friction [-] and cone index [Pa, 0 if not said] at many points, shape as `x` and `y` [m]."""
    rows, columns = surface.friction.shape
    i, j = (np.floor((v - v0) / surface.spacing).astype(int) for v, v0 in ((x, surface.x0), (y, surface.y0)))
    there = (i >= 0) & (i < columns) & (j >= 0) & (j < rows)
    friction, cone_index = np.ones(x.shape), np.zeros(x.shape)
    friction[there], cone_index[there] = (a[j[there], i[there]] for a in (surface.friction, surface.cone_index))
    return friction, cone_index


def _painted(ground: Ground, positions: Array, tiles: Array, level: Array) -> Array:
    """Colours of the vertices, shape (n, 3), uint8; `level` are the heights [m] that the ramp spans."""
    colours = by_height(positions[:, 2], float(level.min()), float(level.max()))
    inward = positions[:, :2] + 0.01 * (tiles[:, :2] - positions[:, :2])
    colours = by_soil(colours, *properties(ground.surface, inward[:, 0], inward[:, 1]))
    dark, light = SHADES
    shaded = colours * (dark + (light - dark) * tiles[:, 2:])
    found: Array = np.clip(shaded, 0, 255).astype(np.uint8)
    return found
