"""Recording of field work for the Rerun viewer: field boundary and, after the run, passes, gaps and overlaps."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.palette import GREEN, ORANGE, VERMILION, rgba
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.coverage import FieldCoverage
from agrobot_mj.extensions.fields.raster import OUTSIDE, pass_map
from agrobot_mj.plants.scene import Scene
from agrobot_mj.recording import Recording
from agrobot_mj.recording.world.names import REFERENCE
from agrobot_mj.recording.world.outlines import LIFT_M, send_grid, send_outlines
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log, Rows

LEVEL_M = 0.05  # Maximum height difference of ground on which the horizontal map of passes is drawn [m]
GRASS = "#657543"  # Colour of cells without passes, close to the colour of the ground
COLOURS = np.array([list(rgba(colour).to_bytes(4, "big")[:3]) for colour in (GRASS, GREEN, ORANGE)], dtype=np.uint8)
"""Colours (RGB) of cells without passes, with one pass, and with several passes."""
SMALLEST_M2 = 0.01  # Area below which a gap or an overlap is not drawn in a recording [m2]


class WorkRecording(Recording):
    """Rerun recording of a run with outlines of the field, gaps and overlaps, and a map of passes on level ground."""

    def __init__(self, path: Path, field: BaseGeometry, covered: Callable[[Log], FieldCoverage]) -> None:
        super().__init__(path)
        self.field, self.covered = field, covered

    def start(self, scenario: Scenario, scene: Scene, rows: Rows) -> None:
        """Open the recording file, and write the scene and the field boundary."""
        super().start(scenario, scene, rows)
        self._send("boundary", self.field, REFERENCE)

    def finish(self, log: Log) -> None:
        """Write the outlines of gaps and overlaps, then finish the recording."""
        self.wait()
        found = self.covered(log)
        self._send("missed", found.missed, rgba(VERMILION))
        self._send("overlapped", found.overlapped, rgba(ORANGE))
        if self.recording:
            self._send_passes(found)
        super().finish(log)

    def _send_passes(self, found: FieldCoverage) -> None:
        heights = self.scenario.terrain.ground().heights
        if np.ptp(heights) <= LEVEL_M:
            (cells, cell), (west, _, _, north) = pass_map(found), found.field.bounds
            counts = np.where(cells == OUTSIDE, 0, cells.clip(max=len(COLOURS) - 1))
            corner = west, north - cell * len(cells), float(heights.max()) + LIFT_M / 2
            send_grid(self.stream, "passes", COLOURS[counts], corner, cell)

    def _send(self, name: str, area: BaseGeometry, colour: int) -> None:
        if self.recording and (rings := outlines(area)):
            send_outlines(self.stream, self.scenario.terrain.ground(), name, rings, colour)


def outlines(area: BaseGeometry) -> list[Array]:
    """Return the rings of an area, shape (n, 2) each [m], without polygons smaller than `SMALLEST_M2`."""
    parts = [part for part in shapely.get_parts(area) if part.geom_type == "Polygon" and part.area > SMALLEST_M2]
    return [np.array(ring.coords)[:, :2] for part in parts for ring in (part.exterior, *part.interiors)]
