"""Tyre marks: a flat strip behind each wheel with the width of the tyre, coloured by slip.

Marks are sent as small meshes with the same triangle indices, each with its end time. The layout shows all marks up to
the current time. A wheel in the air leaves no mark.
"""

import numpy as np
import rerun as rr

from agrobot_mj.core.palette import ORANGE, rgba
from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.recording.transport.timeline import Index, Times, nanoseconds, send
from agrobot_mj.recording.world.colours import ramp
from agrobot_mj.recording.world.ground import on_ground
from agrobot_mj.recording.world.wheels import Wheels

Triangles = np.ndarray[tuple[int, ...], np.dtype[np.uint32]]
ENTITY = "world/tracks/tyres"
PIECES = (10, 20, 40, 100, 200)  # Possible numbers of ticks per segment of a mark
MOST_PIECES = 800  # Maximum number of segments per run. Each segment is a separate mesh in the viewer.
STEP_TICKS, ROUGH_STEP_TICKS = 5, 2
"""Number of ticks between the cross-sections of a tyre mark, on a plane and on relief: 0.3 m and 0.12 m at 1.2 m/s."""
LIFTS_M = np.array([0.004, 0.004, 0.006, 0.006])
"""Heights of the tyre marks above the ground for the four wheels [m]. Rear marks are above front marks."""
SLIP_COLOURS = ((0.02, 0x4A3F2BFF), (0.12, rgba(ORANGE)), (0.3, 0xE02010FF))
"""Pairs of slip [-] and colour 0xRRGGBBAA: brown (pressed earth), orange and red."""


class Trail:
    """Recorder that sends tyre marks to a recording."""

    def __init__(self, wheels: Wheels, ticks: int) -> None:
        self.wheels, self.sent = wheels, 0
        self.piece = next((size for size in PIECES if ticks <= size * MOST_PIECES), PIECES[-1])
        self.step = STEP_TICKS if wheels.ground.is_plane else ROUGH_STEP_TICKS

    def send(self, stream: rr.RecordingStream, times: Times, first: int) -> None:
        """Send the tyre mark segments that end at or after the log row `first`; `times` (n,) are the times of the
        rows."""
        if first == 0:
            stream.log(ENTITY, rr.Mesh3D.from_fields(triangle_indices=self._triangles()), static=True)
        ends = np.arange(self.sent + self.piece, first + len(times), self.piece)
        self._send_pieces(stream, times[ends - first], ends)

    def finish(self, stream: rr.RecordingStream, last: int) -> None:
        """Send the last segment of the tyre marks, which ends at log row `last`."""
        if last > self.sent:
            self._send_pieces(stream, nanoseconds(self.wheels.rows.column("t")[[last]]), np.array([last]))

    def _send_pieces(self, stream: rr.RecordingStream, times: Times, ends: Index) -> None:
        if not ends.size:
            return
        sections = np.arange(0, self.piece + 1, self.step)
        at = np.minimum((np.append(self.sent, ends[:-1])[:, None] + sections), ends[:, None])
        self.sent = int(ends[-1])
        edges, colours = self.marks(at.ravel())
        count = 2 * len(WHEELS) * len(sections)
        columns = rr.Mesh3D.columns(vertex_positions=edges.reshape(-1, 3), vertex_colors=colours.ravel())
        send(stream, ENTITY, times, columns.partition(np.full(len(ends), count)))

    def marks(self, at: Index) -> tuple[Array, Array]:
        """Return the left and right edges of the tyre marks at n log rows `at`, shape (n, 4, 2, 3) [m], and their
        colours (n, 4, 2)."""
        contacts, report = self.wheels.contacts(at), self.wheels.report
        width = np.where(report("load", at) > 0, self.wheels.half_widths, 0.0)[..., None]
        edges = np.stack([contacts.patch + width * contacts.left, contacts.patch - width * contacts.left], axis=2)
        flat = on_ground(self.wheels.ground, edges[..., :2].reshape(-1, 2), 0.0).reshape(edges.shape)
        flat[..., 2] += LIFTS_M[:, None]
        slip = np.nan_to_num(np.hypot(report("slip_ratio", at), np.tan(report("slip_angle", at))))
        return flat.astype(np.float32), np.repeat(ramp(SLIP_COLOURS, slip)[..., None], 2, axis=2)

    def _triangles(self) -> Triangles:
        """Return the triangles of a segment of the tyre marks, shape (n, 3), for vertices ordered by cross-section,
        wheel and edge."""
        sections, row = self.piece // self.step, 2 * len(WHEELS)
        left = row * np.arange(sections)[:, None] + 2 * np.arange(len(WHEELS))
        quads = left[..., None] + np.array([0, 1, row + 1, 0, row + 1, row])
        triangles: Triangles = quads.reshape(-1, 3).astype(np.uint32)
        return triangles
