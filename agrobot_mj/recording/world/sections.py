"""Row of boxes on a body, whose colours change during a run, for the sections of an implement."""

import numpy as np
import rerun as rr
from rerun.components import FillMode

from agrobot_mj.core.signals import Array
from agrobot_mj.recording.transport.timeline import nanoseconds, send

Colours = np.ndarray[tuple[int, ...], np.dtype[np.uint32]]


def send_sections(
    stream: rr.RecordingStream, body: str, centres: Array, half_sizes: Array, times: Array, colours: Colours
) -> None:
    """Send n boxes with `centres` and `half_sizes` (n, 3) [m] in the frame of `body`.

    `colours` (m, n) are the colours 0xRRGGBBAA of the boxes from each of the `times` (m,) [s] on.
    """
    entity = f"world/bodies/{body}/sections"
    shape = rr.Boxes3D.from_fields(half_sizes=half_sizes, centers=centres, fill_mode=FillMode.Solid)
    stream.log(entity, shape, static=True)
    columns = rr.Boxes3D.columns(colors=colours.ravel()).partition(np.full(len(times), len(centres)))
    send(stream, entity, nanoseconds(times), columns)
