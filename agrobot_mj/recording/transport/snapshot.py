"""Pictures of a recording without a display: Rerun's own viewer, drawing into memory.

The viewer needs a Vulkan driver; Mesa's software one will do. Pictures are written whole or not at all.
"""

import os
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rerun.experimental import ViewerClient

from agrobot_mj.recording.transport.timeline import TIMELINE
from agrobot_mj.recording.transport.viewer import RERUN, end, free_port
from agrobot_mj.simulation.storage import whole

SIZE = "1920x1080"
"""Of the pictures [pixels]."""
START_S = 30.0
"""How long the viewer may take to start [s]."""
LOAD_S = 60.0
"""How long a recording may take to load [s]."""
TOASTS_S = 4.5
"""How long the viewer's own messages lie over the picture after its start [s]."""
SETTLE_S = 0.4
"""From a new time or tab until all views are drawn [s]."""
REMEDY = "on Debian and Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1"


class SnapshotError(Exception):
    """No pictures, and why; the message says what to do."""


def snapshots(file: Path, times: Sequence[float], folder: Path, tabs: Sequence[str] = ()) -> list[Path]:
    """One PNG for each tab (all if none is named) at each time [s], as `folder`/<tab>_<time>.png.

    Raises `SnapshotError` if the viewer cannot draw, cannot open the file, or has no such tab.
    """
    written = []
    with _viewer() as viewer:
        layout = _opened(viewer, file)
        root, named = _tabs(layout)
        unknown = [name for name in tabs if name.lower() not in {there.lower() for there in named}]
        if unknown:
            raise SnapshotError(f"{file}: no tab {unknown[0]}; there are {', '.join(named)}")
        for name, place in named.items():
            if tabs and name.lower() not in {wanted.lower() for wanted in tabs}:
                continue
            layout[root]["ContainerBlueprint"]["active_tab"] = place
            viewer.set_blueprint(layout, "recording")
            for t in times:
                path = folder / f"{name.lower()}_{t:g}.png"
                with whole(path) as temporary:
                    temporary.write_bytes(_picture(viewer, t))
                written.append(path)
    return written


def _picture(viewer: ViewerClient, t: float) -> bytes:
    viewer.set_time(TIMELINE, duration=t, play_state="paused")
    viewer.take_screenshot(max_size=64)  # the first frame loads what is shown
    time.sleep(SETTLE_S)
    return viewer.take_screenshot()


def _opened(viewer: ViewerClient, file: Path) -> dict[str, Any]:
    """Load `file` and return its layout."""
    deadline = time.monotonic() + LOAD_S
    if not viewer.open(str(file.resolve())).store_ids:
        raise SnapshotError(f"{file}: the viewer cannot open it; is it a recording (.rrd)?")
    while viewer.get_state().loading:
        if time.monotonic() > deadline:
            raise SnapshotError(f"{file}: not loaded after {LOAD_S:g} s")
        time.sleep(0.1)
    time.sleep(TOASTS_S)
    return viewer.get_blueprint().blueprint


def _tabs(layout: dict[str, Any]) -> tuple[str, dict[str, str]]:
    """Where the tabs are in the layout, and the place of each by its name."""
    for place, parts in layout.items():
        container = parts.get("ContainerBlueprint", {})
        if container.get("container_kind") == "Tabs":
            return place, {_name(layout[child]): child for child in container["contents"]}
    raise SnapshotError("the recording has no tabs; was it written by agrobot-mj?")


def _name(parts: dict[str, Any]) -> str:
    return str(next(part["display_name"] for part in parts.values() if "display_name" in part))


@contextmanager
def _viewer() -> Iterator[ViewerClient]:
    """A viewer without a window, on loopback, that ends with the block."""
    port = free_port()
    command = [*RERUN, "--headless", "--window-size", SIZE]
    command += ["--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen"]
    environment = {**os.environ, "RUST_LOG": "error"}  # what it logs would lie over the picture
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(command, env=environment, stdout=quiet, stderr=subprocess.PIPE, start_new_session=True)
    try:
        yield _connected(process, port)
    except (RuntimeError, ConnectionError) as error:
        raise SnapshotError(_why(process, error)) from None
    finally:
        end(process)


def _connected(process: "subprocess.Popen[bytes]", port: int) -> ViewerClient:
    """A client of the viewer once it draws."""
    deadline = time.monotonic() + START_S
    while process.poll() is None and time.monotonic() < deadline:
        try:
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.take_screenshot(max_size=16)
        except (RuntimeError, ConnectionError):
            time.sleep(0.2)
        else:
            return client
    raise RuntimeError("the viewer did not start")


def _why(process: "subprocess.Popen[bytes]", error: Exception) -> str:
    """What went wrong, from what the viewer said before it ended."""
    end(process)
    said = process.stderr.read().decode(errors="replace") if process.stderr else ""
    if "adapter" in said or "render context" in said:
        return f"no pictures: Rerun's viewer finds no Vulkan driver; {REMEDY}"
    return f"no pictures: {error}; if the viewer finds no Vulkan driver, {REMEDY}"
