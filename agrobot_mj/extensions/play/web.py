"""Web viewer of MuJoCo Studio, accessible only from this computer by default.

MuJoCo Studio opens its port on all network interfaces without authentication, and accepts connections from pages of
other sites. This viewer uses only the loopback interface and rejects other sites, unless network access is enabled.
"""

import io
import logging
import sys
import threading
from collections.abc import Awaitable, Callable, Sequence
from contextlib import redirect_stdout, suppress
from typing import Any

from mujoco.studio import endpoints, launch_thread, viewer_handle, viewer_protocol, web_viewer
from mujoco.studio.web import web_server
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.play.gamepad import SCRIPT, SOCKET, Gamepad

LOOPBACK, EVERYWHERE = "127.0.0.1", "::"
START_S = 20.0  # Maximum start-up time of the viewer [s]. Assumed value, sufficient for a busy computer.
SERVE = web_server.serve  # Function of MuJoCo Studio that starts a server. This server accepts pages of any site.
PAGES = ("/", "/index.html")  # URL paths of the page
DROP = "/drop"  # URL path on which MuJoCo Studio receives models, which it would keep in memory during a drive
STATE = "/state"  # URL path of the stream of poses, to which each page that shows the tractor is connected


class _EndedConnections(logging.Filter):
    """Filter that omits log records about connections that a page has ended, for example during a reload."""

    def filter(self, record: logging.LogRecord) -> bool:
        error = record.exc_info[1] if record.exc_info else None
        # websockets reports an internal error if a page resets its connection before the response is complete
        return not isinstance(error, ConnectionClosed | ConnectionError | AssertionError)


ENDED = _EndedConnections()


class PlayViewer(web_viewer.WebViewer):  # type: ignore[misc, unused-ignore]
    """Web viewer of MuJoCo Studio, restricted to this computer unless network access is enabled."""

    clients = 0
    """Number of browser pages that display the tractor at present."""

    def __init__(self, *given: Any, pad: Gamepad, network: bool = False, **options: Any) -> None:
        """Start the server of the viewer. Messages about a gamepad are passed to `pad`. With `network`, the server
        accepts connections from other computers and pages of all sites."""
        self.pad, self.network = pad, network
        super().__init__(*given, **options)

    @property
    def _host(self) -> str:
        return EVERYWHERE if self.network else LOOPBACK

    @_host.setter
    def _host(self, _fixed: str) -> None:
        """Ignore the network address that MuJoCo Studio assigns, because `network` determines the address."""

    @property
    def port(self) -> int:
        """TCP port on which the viewer serves its page."""
        return int(self._http_sock.getsockname()[1])

    def _start_server(self) -> None:
        # Without this flag, a frame crashes if it begins while a page disconnects: the fonts exist only while connected
        web_viewer.imgui.GetIO().BackendFlags |= int(web_viewer.imgui.BackendFlags.RendererHasTextures)
        web_server.serve = self._serve
        super()._start_server()

    def _serve(self, handler: Callable[[ServerConnection], Awaitable[None]], **options: Any) -> Any:
        """Start the server of MuJoCo Studio. Count the connected pages, and add the gamepad to the page."""
        respond: Callable[[ServerConnection, Request], Response | None] = options.pop("process_request")

        async def handle(connection: ServerConnection) -> None:
            path = connection.request.path if connection.request is not None else ""
            if path == SOCKET:
                with suppress(ConnectionClosed):
                    async for text in connection:
                        self.pad.receive(text)
                return
            if path.startswith(DROP):
                return
            shows = path.startswith(STATE)
            self.clients += shows
            try:
                await handler(connection)
            finally:
                self.clients -= shows

        def answer(connection: ServerConnection, request: Request) -> Response | None:
            if request.path == SOCKET:
                return None
            response = respond(connection, request)
            if response is None or response.status_code != 200 or request.path.partition("?")[0] not in PAGES:
                return response
            return _with_gamepad(response)

        return SERVE(handle, origins=self.origins, process_request=answer, **options)

    @property
    def origins(self) -> list[str] | None:
        """Sites whose pages may connect to the server, or None for all sites."""
        return None if self.network else [f"http://{name}:{self.port}" for name in (LOOPBACK, "localhost")]


def _with_gamepad(page: Response) -> Response:
    """Return the web page, to which the script that reads a gamepad is added."""
    page.body = page.body.replace(b"</body>", SCRIPT.encode() + b"</body>")
    del page.headers["Content-Length"]
    page.headers["Content-Length"] = str(len(page.body))
    return page


def launch(
    port: int, network: bool, viewer_plugins: Sequence[Any], sim_plugins: Sequence[Any], pad: Gamepad
) -> tuple[Any, PlayViewer]:
    """Start the viewer in a thread. Return two values: the handle of the thread, and the viewer. `pad` receives gamepad
    messages.

    Raise `ScenarioError` if the port is in use or the viewer does not start.
    """
    started, found = threading.Event(), list[PlayViewer]()

    def serve(endpoint: endpoints.ViewerEndpoint) -> None:
        config = viewer_protocol.ViewerConfig(title="agrobot-mj play", gfx="web", http_port=port)
        try:
            found.append(PlayViewer(config, endpoint, plugins=list(viewer_plugins), pad=pad, network=network))
        finally:
            started.set()
        viewer_protocol.run_viewer_loop(found[0])

    logging.getLogger("WebServer").setLevel(logging.WARNING)
    for name in ("asyncio", "websockets.server"):
        logging.getLogger(name).addFilter(ENDED)
    with redirect_stdout(io.StringIO()):  # the banner of the server lists other addresses
        handle: viewer_handle.ViewerHandle = launch_thread.launch_thread(serve, sim_plugins=list(sim_plugins))
        started.wait(START_S)
    if not found:
        try:
            handle.close()
        except (RuntimeError, OSError) as error:
            raise ScenarioError(f"--port {port}: {error}") from None
        raise ScenarioError(f"play: the viewer did not start within {START_S:g} s; retry on an idle computer")
    return handle, found[0]


def closing(handle: Any) -> threading.Thread:
    """Start and return a thread that stops the viewer and its server, and prints errors of the viewer."""

    def close() -> None:
        try:
            handle.close()
        except Exception as error:
            with suppress(OSError):
                print(f"play: the viewer failed: {error}", file=sys.stderr)

    thread = threading.Thread(target=close, daemon=True)
    thread.start()
    return thread
