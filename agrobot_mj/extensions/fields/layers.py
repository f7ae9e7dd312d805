"""Recording of field work for the Rerun viewer: field boundary and, after the run, passes, gaps, overlaps and sections.

The sections are boxes that move with the implement, green while they work.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agrobot_mj.core.palette import GREEN, GREY, ORANGE, VERMILION, rgba
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.fields.evaluation import FieldDrive
from agrobot_mj.extensions.fields.raster import OUTSIDE, PassMap
from agrobot_mj.paths.track import Mask
from agrobot_mj.plants.mujoco.clearance import rotation_of
from agrobot_mj.plants.scene import Scene
from agrobot_mj.recording import Recording
from agrobot_mj.recording.world.ground import on_ground
from agrobot_mj.recording.world.names import REFERENCE
from agrobot_mj.recording.world.outlines import send_image, send_outlines
from agrobot_mj.recording.world.sections import send_sections
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log, Rows

GRASS = "#657543"  # Colour of cells without passes, close to the colour of the ground
COLOURS = np.array([list(rgba(colour).to_bytes(4, "big")[:3]) for colour in (GRASS, GREEN, ORANGE)], dtype=np.uint8)
"""Colours (RGB) of cells without passes, with one pass, and with several passes."""
SWITCHED = np.array([rgba(GREY), rgba(GREEN)], dtype=np.uint32)  # Colours of sections that are off and on
HEIGHT_M, HALF_SIZES_M, GAP_M = 0.3, (0.1, 0.01, 0.05), 0.03
"""Height of the sections above the ground, minimum half sizes of a section, and half the gap between sections [m]."""
SMALLEST_M2 = 0.01  # Area below which a gap or an overlap is not drawn in a recording [m2]


class WorkRecording(Recording):
    """Rerun recording of a run with outlines of the field, gaps and overlaps, a map of passes, and the sections."""

    def __init__(self, path: Path, field: BaseGeometry, drive_of: Callable[[Log], FieldDrive]) -> None:
        super().__init__(path)
        self.field, self.drive_of = field, drive_of

    def start(self, scenario: Scenario, scene: Scene, rows: Rows) -> None:
        """Open the recording file, and write the scene and the field boundary."""
        super().start(scenario, scene, rows)
        self._send("boundary", self.field, REFERENCE)

    def finish(self, log: Log) -> None:
        """Write the outlines of gaps and overlaps, the map of passes and the sections, then finish the recording."""
        self.wait()
        drive = self.drive_of(log)
        self._send("missed", drive.coverage.missed, rgba(VERMILION))
        self._send("overlapped", drive.coverage.overlapped, rgba(ORANGE))
        if self.recording:
            self._send_passes(drive.pass_map)
            self._send_sections(drive)
        super().finish(log)

    def _send_passes(self, found: PassMap) -> None:
        counts = np.where(found.cells == OUTSIDE, 0, found.cells.clip(max=len(COLOURS) - 1))
        corner = found.bounds[0], found.bounds[3] - found.cell * len(counts)
        send_image(self.stream, self.scenario.terrain.ground(), "passes", COLOURS[counts], corner, found.cell)

    def _send_sections(self, drive: FieldDrive) -> None:
        bodies = self.motion.scene.bodies
        body = bodies.index("implement") if "implement" in bodies else 0
        pose, place = drive.log.poses[0, body], [[drive.motion.x[0], drive.motion.y[0]]]
        bar = on_ground(self.scenario.terrain.ground(), np.array(place), HEIGHT_M)[0]
        edges = np.array([drive.boom.edges(section) for section in range(drive.boom.sections)])
        centres = np.zeros((len(edges), 3))
        centres[:, 1] = edges.mean(axis=1)
        centres += rotation_of(pose[3:]).T @ (bar - pose[:3])
        half_sizes = np.tile(HALF_SIZES_M, (len(edges), 1))
        half_sizes[:, 1] = np.maximum(half_sizes[:, 1], (edges[:, 0] - edges[:, 1]) / 2 - GAP_M)
        times, on = switching_states(drive)
        send_sections(self.stream, bodies[body], centres, half_sizes, times, SWITCHED[on.astype(int)])

    def _send(self, name: str, area: BaseGeometry, colour: int) -> None:
        if self.recording and (rings := outlines(area)):
            send_outlines(self.stream, self.scenario.terrain.ground(), name, rings, colour)


def outlines(area: BaseGeometry) -> list[Array]:
    """Return the rings of an area, shape (n, 2) each [m], without polygons smaller than `SMALLEST_M2`."""
    parts = [part for part in shapely.get_parts(area) if part.geom_type == "Polygon" and part.area > SMALLEST_M2]
    return [np.array(ring.coords)[:, :2] for part in parts for ring in (part.exterior, *part.interiors)]


def switching_states(drive: FieldDrive) -> tuple[Array, Mask]:
    """Return the times (n,) at which sections are switched [s], including the start of the run, and whether each
    section works from these times on, shape (n, sections)."""
    spans = [(section, *span) for times in drive.times for section, span in enumerate(times) if span]
    times = np.unique([drive.motion.t[0], *(t for _, *span in spans for t in span)])
    on = np.zeros((len(times), drive.boom.sections), dtype=bool)
    for section, *span in spans:
        on[slice(*np.searchsorted(times, span)), section] = True
    return times, on
