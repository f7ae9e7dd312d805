"""Images and animations of a recording, rendered by the Rerun viewer without a display.

The viewer needs a Vulkan driver; the software driver of Mesa is sufficient. The title bar of the viewer, which contains
information about the computer, is removed. Image files are written atomically. A viewer that fails or exceeds its time
limit, for example on a busy machine, is restarted with a longer limit.
"""

import io
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image
from rerun.experimental import ViewerClient

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import ROUNDING_S, TICK_S, Array
from agrobot_mj.recording.transport.mending import whole
from agrobot_mj.recording.transport.timeline import TIMELINE
from agrobot_mj.recording.transport.viewer import RERUN, end, free_port, start_viewer
from agrobot_mj.simulation.progress import tally
from agrobot_mj.simulation.results import atomic, check_names

Kind = Literal["png", "gif", "mp4"]  # Format of the output file
SIZE, TITLE_BAR = (1920, 1080), 37  # Width and height of the images, and height of the removed title bar [pixels]
ANIMATED_S, FRAMES_PER_S, ANIMATED_SIZE, ANIMATED_COLOURS = 10.0, 10, (960, 540), 128
"""Duration [s], frame rate [1/s], maximum size [pixels] and number of colours of an animation."""
SHOWN_S = 60.0  # Default time at which an image shows the recording [s]. A shorter recording is shown at its end.
TRIES = 3  # Maximum number of attempts. Attempt number n has n times the time limits of the first attempt.
START_S = 30.0  # Time limit for the start of the viewer in the first attempt [s]
LOAD_S = 60.0  # Time limit for loading a recording in the first attempt [s]
TOASTS_S = 4.5  # Time after the start during which messages of the viewer cover the image [s]
SETTLE_S, SETTLE_FRAME_S = 0.4, 0.05
"""Waiting times for rendering all views [s]: after a change of time or tab, and after each frame of an animation."""
REMEDY = "on Debian and Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1"


class SnapshotError(Exception):
    """Error that prevents rendering of a recording. The message names the file and the fix."""


class _LateError(Exception):
    """Temporary failure of the viewer, after which the rendering is repeated with longer time limits."""


def snapshots(
    file: Path,
    times: Sequence[float],
    folder: Path,
    tabs: Sequence[str] = (),
    kind: Kind = "png",
    size: tuple[int, int] = SIZE,
    quiet: bool = True,
) -> list[Path]:
    """Write an image of each tab (default: all) at each time [s] to `folder`/<tab>_<time>.png. Return the files.

    If `tabs` contains the name of a 3D view, this view fills the image. With `kind` "gif" or "mp4", a 10 s animation
    starts at each time or ends with the recording; "mp4" requires the program ffmpeg. Default time: `SHOWN_S`, or the
    end of a shorter recording. `size` is the width and height of the images [pixels]. Progress is printed to stderr
    unless `quiet`.

    Raise `SnapshotError` if the viewer cannot render or open the file, and `ScenarioError` for an unknown tab or a time
    after the end.
    """
    if kind == "mp4" and shutil.which("ffmpeg") is None:
        raise ScenarioError("--mp4: ffmpeg is not installed (apt-get install ffmpeg); --gif works without it")
    drawn: dict[Path, None] = {}
    with whole(file) as readable:
        for patience in range(1, TRIES + 1):
            try:
                with _viewer(file, patience, size) as viewer:
                    layout = _open_recording(viewer, file, readable, patience)
                    _draw(viewer, file, layout, times, folder, tabs, drawn, kind, quiet)
                return list(drawn)
            except _LateError as error:
                cause = str(error)
    raise SnapshotError(
        f"{file}: no images in {TRIES} attempts: {cause}; retry on an idle computer or use fewer --tab and --at options"
    )


def _draw(
    viewer: ViewerClient,
    file: Path,
    layout: dict[str, Any],
    times: Sequence[float],
    folder: Path,
    tabs: Sequence[str],
    drawn: dict[Path, None],
    kind: Kind,
    quiet: bool,
) -> None:
    root, named = _tabs(file, layout)
    asked, views = {name.lower() for name in tabs}, _views(layout)
    every = named | views  # a maximised view hides the tabs that follow
    known = {name.lower() for name in every}
    if unknown := [name for name in tabs if name.lower() not in known]:
        raise ScenarioError(f"{file}: there is no tab or view {unknown[0]} (available: {', '.join(every)})")
    shown = {name: place for name, place in every.items() if name.lower() in asked} if asked else named
    end_s = _end(viewer)
    times = times or (min(SHOWN_S, end_s),)
    if (last := max(times)) > end_s + TICK_S + ROUNDING_S:
        raise ScenarioError(f"{file}: --at {last:g}: the recording ends at {end_s:g} s; use an earlier time")
    draw = _picture if kind == "png" else partial(_animation, end_s, kind)
    files = {(tab, t): folder / f"{tab.lower().replace(' ', '_')}_{t:g}.{kind}" for tab in shown for t in times}
    check_names(folder, {path.name for path in files.values()} - {path.name for path in drawn})
    counts = {t: 1 if kind == "png" else len(frame_times(t, end_s)) for t in times}
    total, done = (sum(counts[t] for (_, t), path in files.items() if path in of) for of in (files.values(), drawn))
    with tally(f"{file.name}: {total} pictures", total, done, quiet) as advance:
        for name, place in shown.items():
            view = place.removeprefix("/view/") if name in views else None
            if view:
                layout["/viewport"]["ViewportBlueprint"]["maximized"] = view
            else:
                layout[root]["ContainerBlueprint"]["active_tab"] = place
            viewer.set_blueprint(layout, "recording")
            for t in times:
                path = files[name, t]
                if path not in drawn:
                    with atomic(path) as temporary:
                        temporary.write_bytes(draw(viewer, t, view, advance))
                    drawn[path] = None


def _picture(viewer: ViewerClient, t: float, view: str | None, advance: Callable[[], None]) -> bytes:
    shown = _encode_frames([_frame(viewer, t, view)], "PNG")
    advance()
    return shown


def _animation(
    end_s: float, kind: Kind, viewer: ViewerClient, t: float, view: str | None, advance: Callable[[], None]
) -> bytes:
    frames = []
    for k, at in enumerate(frame_times(t, end_s).tolist()):
        frames.append(_frame(viewer, at, view, SETTLE_FRAME_S if k else SETTLE_S))
        if kind == "gif":
            frames[-1].thumbnail(ANIMATED_SIZE)
        advance()
    if kind == "mp4":
        return as_mp4(frames)
    palette = common_palette(frames)
    return _encode_frames([frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames], "GIF")


def as_mp4(frames: Sequence[Image.Image]) -> bytes:
    """Return the frames as an MP4 video for browsers, encoded with ffmpeg. Raise `SnapshotError` if ffmpeg fails."""
    even = "scale=trunc(iw/2)*2:trunc(ih/2)*2"  # the pixel format requires even sizes
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "video.mp4"
        command = ("ffmpeg", "-loglevel", "error", "-f", "image2pipe", "-framerate", str(FRAMES_PER_S), "-i", "-")
        encoding = ("-vf", even, "-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(file))
        images = b"".join(_encode_frames([frame], "PNG") for frame in frames)
        done = subprocess.run((*command, *encoding), input=images, capture_output=True, check=False)
        if done.returncode or not file.is_file():
            raise SnapshotError(f"--mp4: ffmpeg failed: {done.stderr.decode(errors='replace').strip()[-300:]}")
        return file.read_bytes()


def frame_times(t: float, end: float) -> Array:
    """Return the frame times of an animation from `t` [s].

    The animation starts earlier if less than `ANIMATED_S` remain until the end of the recording, `end` [s].
    """
    times = max(min(t, end - ANIMATED_S), 0.0) + np.arange(round(ANIMATED_S * FRAMES_PER_S)) / FRAMES_PER_S
    return times[: max(np.searchsorted(times, end), 1)]


def _end(viewer: ViewerClient) -> float:
    lines = [line for recording in viewer.get_state().recordings for line in recording.timelines]
    return max((line.end / 1e9 for line in lines if line.name == TIMELINE and line.end is not None), default=0.0)


def common_palette(frames: Sequence[Image.Image]) -> Image.Image:
    """Return one colour palette for all frames of an animation, from about ten evenly spaced frames and the last
    frame."""
    some = frames[:: -max(len(frames) // 10, 1)]
    still = Image.new("RGB", (some[0].width, sum(frame.height for frame in some)))
    for k, frame in enumerate(some):
        still.paste(frame, (0, k * frame.height))
    return still.quantize(ANIMATED_COLOURS)


def _frame(viewer: ViewerClient, t: float, view: str | None, settle_s: float = SETTLE_S) -> Image.Image:
    """Return an image of the viewer, or of its view with the id `view`, at time `t` [s]. The title bar is removed."""
    viewer.set_time(TIMELINE, duration=t, play_state="paused")
    viewer.take_screenshot(max_size=64)  # loads the data of the first frame
    time.sleep(settle_s)
    with Image.open(io.BytesIO(viewer.take_screenshot(view))) as shown:
        return shown.convert("RGB").crop((0, 0 if view else TITLE_BAR, shown.width, shown.height))


def _encode_frames(frames: Sequence[Image.Image], kind: str) -> bytes:
    content, first = io.BytesIO(), frames[0]
    first.save(content, kind, save_all=len(frames) > 1, append_images=frames[1:], duration=1000 // FRAMES_PER_S, loop=0)
    return content.getvalue()


def _open_recording(viewer: ViewerClient, file: Path, readable: Path, patience: int) -> dict[str, Any]:
    deadline = time.monotonic() + patience * LOAD_S
    if not viewer.open(str(readable.resolve())).store_ids:
        raise SnapshotError(f"{file}: the viewer cannot open the file; specify a recording (.rrd)")
    while viewer.get_state().loading:
        if time.monotonic() > deadline:
            raise _LateError(f"the recording was not loaded within {patience * LOAD_S:g} s")
        time.sleep(0.1)
    time.sleep(TOASTS_S)
    return viewer.get_blueprint().blueprint


def _tabs(file: Path, layout: dict[str, Any]) -> tuple[str, dict[str, str]]:
    for place, parts in layout.items():
        container = parts.get("ContainerBlueprint", {})
        if container.get("container_kind") == "Tabs":
            return place, {_name(layout[child]): child for child in container["contents"]}
    raise SnapshotError(
        f"{file}: the recording has no tabs; it is truncated, or its run has no tick; record the run again"
    )


def _views(layout: dict[str, Any]) -> dict[str, str]:
    views = {place: parts for place, parts in layout.items() if "ViewBlueprint" in parts}
    return {_name(parts): place for place, parts in views.items() if parts["ViewBlueprint"]["class_identifier"] == "3D"}


def _name(parts: dict[str, Any]) -> str:
    return str(next(part["display_name"] for part in parts.values() if "display_name" in part))


@contextmanager
def _viewer(file: Path, patience: int, size: tuple[int, int]) -> Iterator[ViewerClient]:
    port = free_port()
    command = [*RERUN, "--headless", "--window-size", f"{size[0]}x{size[1] + TITLE_BAR}"]
    command += ["--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen"]
    environment = {**os.environ, "RUST_LOG": "error"}  # log messages would cover the image
    with start_viewer(command, environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        try:
            yield _connect_viewer(process, port, patience * START_S)
        except (RuntimeError, ConnectionError, TimeoutError) as error:
            if _lacks_driver(process):
                raise SnapshotError(
                    f"{file}: no images, because the Rerun viewer cannot find a Vulkan driver; {REMEDY}"
                ) from None
            raise _LateError(str(error)) from None


def _connect_viewer(process: "subprocess.Popen[bytes]", port: int, seconds: float) -> ViewerClient:
    deadline = time.monotonic() + seconds
    while process.poll() is None and time.monotonic() < deadline:
        try:
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.take_screenshot(max_size=16)
        except (RuntimeError, ConnectionError):
            time.sleep(0.2)
        else:
            return client
    raise RuntimeError(
        f"the viewer did not start within {seconds:g} s"
        if process.poll() is None
        else f"the viewer exited with status {process.returncode}"
    )


def _lacks_driver(process: "subprocess.Popen[bytes]") -> bool:
    end(process)
    output = process.stderr.read().decode(errors="replace") if process.stderr else ""
    return "adapter" in output or "render context" in output
