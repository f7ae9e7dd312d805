"""HTML page with a recording and Rerun's web viewer in one file, for browsers without network access.

The viewer comes from the installed rerun-sdk, whose server provides its files on the loopback interface. The viewer and
the recording are compressed and embedded as text. Browsers older than 2023 cannot decompress them.

The page opens the layout of the recording before the recording. If the first frame of a view contained the tractor, the
viewer would replace the camera distance of the layout by a distance at which the tractor does not fit into the view.
"""

import base64
import errno
import gzip
import os
import struct
import subprocess
import time
import urllib.request
from collections.abc import Mapping
from html import escape
from pathlib import Path

from agrobot_mj.recording.transport.mending import whole
from agrobot_mj.recording.transport.viewer import RERUN, free_port, start_viewer
from agrobot_mj.simulation.results import write_text

START_S = 60.0  # Time limit for the start of the viewer's server [s]
LEVEL = 6
HEADER, MESSAGE = 12, struct.Struct("<QQ")
"""Size of the header of a recording [bytes], and header of a message: type, 0 at the end, and size [bytes]."""
LAYOUT, NEAR = b"\x08\x02\x12", 64
"""Start of the identifier of a layout in a message, and size of the start of a message that contains it [bytes]."""
SCRIPT_NAME, MODULE_NAME = "re_viewer.js", "re_viewer_bg.wasm"  # Names of the files of the web viewer
STYLE = """
html, body { margin: 0; height: 100%; background: #0d1011; color: #cad8de; font: 15px/1.4 system-ui, sans-serif; }
body { display: flex; flex-direction: column; }
header { padding: 0.5rem 1rem; }
h1 { font-size: 1.1rem; margin: 0; color: #fff; }
p { margin: 0; overflow-wrap: anywhere; }
main { position: relative; flex: 1; min-height: 0; overflow: hidden; }
#poster { position: absolute; inset: 0; width: 100%; height: 100%; object-fit: contain; }
#state { position: absolute; left: 1rem; bottom: 1rem; padding: 0.3rem 0.7rem; background: #0d1011cc; }
canvas { position: absolute; inset: 0; width: 100%; height: 100%; visibility: hidden; }
.ready canvas { visibility: visible; }
.ready #poster, .ready #state { display: none; }
"""
STARTING = """
const FRAMES = 3;  // so that the viewer has drawn the layout
const state = document.getElementById("state");
async function part(id) {
  const response = await fetch("data:application/octet-stream;base64," + document.getElementById(id).textContent);
  const stream = response.body.pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
async function start() {
  state.textContent = "Unpacking the viewer ...";
  await wasm_bindgen({module_or_path: await part("viewer")});
  const handle = new wasm_bindgen.WebHandle({
    url: [], hide_welcome_screen: true, enable_history: false, notebook: false, persist: false, theme: "dark",
    render_backend: new URLSearchParams(location.search).get("renderer"),
  });
  state.textContent = "Loading the recording ...";
  await handle.start(document.getElementById("canvas"));
  handle.open_channel("run", document.title);
  handle.send_rrd_to_channel("run", await part("layout"));
  for (let k = 0; k < FRAMES; k++) await new Promise(requestAnimationFrame);
  handle.send_rrd_to_channel("run", await part("recording"));
  handle.close_channel("run");
  document.body.classList.add("ready");
}
if (typeof DecompressionStream === "undefined") {
  state.textContent = "This page needs Chrome 91, Firefox 113, Safari 16.4 or newer.";
} else {
  start().catch(error => { state.textContent = "The 3D viewer did not start: " + error; });
}
"""


def write_shared(recording: Path, page: Path, title: str, facts: str, poster: Path | None = None) -> Path:
    """Write an HTML page that contains a recording and the viewer, and return the path of the page.

    `facts` is a line of text below the title, and `poster` is a PNG image that is shown until the viewer has started.
    """
    files = viewer_files()
    with whole(recording) as readable:
        content = readable.read_bytes()
    image = ""
    if poster is not None:
        image = f'<img id="poster" alt="" src="data:image/png;base64,{_base64(poster.read_bytes())}">'
    script = files[SCRIPT_NAME].decode().replace("</script", "<\\/script")
    parts = {"viewer": files[MODULE_NAME], "layout": layout(content), "recording": content}
    packed = "".join(
        f'<script type="text/plain" id="{name}">{_base64(gzip.compress(data, LEVEL))}</script>\n'
        for name, data in parts.items()
    )
    text = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title><link rel="icon" href="data:,"><style>{STYLE}</style></head><body>
<header><h1>{escape(title)}</h1><p>{escape(facts)}</p></header>
<main>{image}<canvas id="canvas"></canvas><p id="state">Loading ...</p></main>
{packed}<script>{script}</script><script>{STARTING}</script></body></html>
"""
    return write_text(page, text)


def layout(recording: bytes) -> bytes:
    """Return the part of a recording that contains only the layout of the viewer."""
    found, start = [recording[:HEADER]], HEADER
    while start + MESSAGE.size <= len(recording):
        kind, size = MESSAGE.unpack_from(recording, start)
        if not kind:
            break
        message = recording[start : (start := start + MESSAGE.size + size)]
        if LAYOUT in message[MESSAGE.size : NEAR]:
            found.append(message)
    return b"".join(found)


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def viewer_files() -> Mapping[str, bytes]:
    """Return the files of rerun-sdk's web viewer by name. Raise OSError if the viewer server does not start."""
    web = free_port()
    ports = ("--port", str(free_port()), "--web-viewer-port", str(web))
    command = (*RERUN, "--web-viewer", "--bind", "127.0.0.1", *ports)
    environment = {**os.environ, "RUST_LOG": "error", "BROWSER": "true"}
    with start_viewer(command, environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + START_S
        while True:
            try:
                return {name: _download(f"http://127.0.0.1:{web}/{name}") for name in (SCRIPT_NAME, MODULE_NAME)}
            except OSError:
                if process.poll() is not None or time.monotonic() > deadline:
                    raise OSError(errno.EIO, "the web viewer of rerun-sdk did not start", RERUN[0]) from None
            time.sleep(0.2)


def _download(address: str) -> bytes:
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    with opener.open(address, timeout=START_S) as response:
        found: bytes = response.read()
    return found
