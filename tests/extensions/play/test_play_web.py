"""Server of the page of `agrobot-mj play`: its network access, its messages, and its end with the command."""

import gc
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import traceback
import urllib.request
from contextlib import ExitStack, contextmanager, redirect_stderr, suppress
from functools import wraps
from io import StringIO
from pathlib import Path
from urllib.error import URLError

import pytest
from processes import Server
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.play import web
from agrobot_mj.extensions.play.gamepad import SOCKET, Gamepad
from agrobot_mj.extensions.play.play import PlayOptions, play
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.run import run

LISTENING = "0A"


def call_and_exit(name, *folders):
    """Call the undecorated test of this name in this process and end the process at once."""
    try:
        globals()[name].__wrapped__(*map(Path, folders))
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)
    os._exit(0)


SERVER = Server("test_play_web", "agrobot_mj.cli.runs", PYTHONPATH=os.pathsep.join(sys.path))


def alone(test):
    """Run a test in a separate process: MuJoCo Studio crashes if a second viewer starts before the first has ended."""

    @wraps(test)
    def run_alone(**arguments):
        call = f"import sys, test_play_web; test_play_web.call_and_exit({test.__name__!r}, *sys.argv[1:])"
        done = SERVER.python(Path.cwd(), "-c", call, *arguments.values())
        assert done.returncode == 0, done.stderr

    return run_alone


def listeners(pid):
    """Return the addresses on which a process listens, as hexadecimal text of the kernel."""
    inodes = set()
    for fd in Path(f"/proc/{pid}/fd").iterdir():
        try:
            inodes |= set(re.findall(r"socket:\[(\d+)\]", str(fd.readlink())))
        except OSError:  # closed meanwhile
            continue
    found = []
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == LISTENING and fields[9] in inodes:
                found.append(fields[1].partition(":")[0])
    return found


def wait_for(port):
    """Wait until the server of the page, which runs in a separate thread, replies."""
    end = time.monotonic() + 30
    while True:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/") as page:
                assert page.status == 200
                return
        except URLError:
            assert time.monotonic() < end
            time.sleep(0.05)


@contextmanager
def served(network=False, pad=None):
    """Start a viewer without a model. Yield its port, and the addresses on which this process additionally listens."""
    before = listeners("self")
    handle, viewer = web.launch(0, network, [], [], pad or Gamepad())
    port = viewer.port
    try:
        wait_for(port)
        after = listeners("self")
        for each in before:
            after.remove(each)
        yield port, after
    finally:
        web.closing(handle).join()


def a_page(url):
    """Connect to the stream of poses, like a page that shows the tractor."""
    address = url.strip("/")
    wait_for(int(address.rpartition(":")[2]))
    return connect(address.replace("http", "ws") + web.STATE, origin=address)


needs_proc = pytest.mark.skipif(not Path("/proc/self/net/tcp").exists(), reason="needs /proc")


@needs_proc
@alone
def test_page_server_listens_only_on_loopback_by_default():
    with served() as (port, addresses):
        assert len(addresses) == 2  # the page, and Studio's own connection to its panel
        assert set(addresses) == {"0100007F"}


@needs_proc
@alone
def test_network_option_makes_the_server_listen_on_the_network():
    with served(network=True) as (_, addresses):
        assert not set(addresses) <= {"0100007F"}


@alone
def test_requests_from_pages_of_other_sites_are_rejected():
    with served() as (port, _):
        for path in ("ui", "state", "drop", "gamepad"):
            address = f"ws://127.0.0.1:{port}/{path}"
            with pytest.raises(InvalidStatus, match="403"):
                connect(address, origin="http://example.org")
            with connect(address, origin=f"http://127.0.0.1:{port}"):
                pass


@alone
def test_page_sends_the_state_of_a_gamepad_to_the_server():
    pad = Gamepad()
    with served(pad=pad) as (port, _):
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/") as page:
            text = page.read().decode()
        assert text.count("gamepadconnected") == 1
        assert text.rstrip().endswith("</html>")
        with connect(f"ws://127.0.0.1:{port}{SOCKET}", origin=f"http://127.0.0.1:{port}") as socket:
            socket.send('{"steer": 0.5, "drive": -1.0, "pressed": ["law"]}')
            until = time.monotonic() + 30
            while not pad.steer and time.monotonic() < until:
                time.sleep(0.01)
    assert (pad.steer, pad.drive, pad.new_presses()) == (0.5, -1.0, ["law"])


@alone
def test_models_dropped_on_the_play_page_are_not_kept():
    handle, viewer = web.launch(0, False, [], [], Gamepad())
    wait_for(viewer.port)
    site = f"127.0.0.1:{viewer.port}"
    options = {"origin": f"http://{site}"}
    with (
        connect(f"ws://{site}/ui?sid=a", **options),
        connect(f"ws://{site}/drop?sid=a", **options) as drop,
        suppress(ConnectionClosed),
    ):
        drop.send(b"\x05\0\0\0a.xml<mujoco/>")
        drop.send(b"")
        drop.recv()
    assert viewer._drop_queue.empty()
    web.closing(handle).join()


@alone
def test_connection_reset_by_a_page_prints_nothing():
    lines = ("GET /state HTTP/1.1", "Host: x", "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13")
    with redirect_stderr(StringIO()) as said:
        with served() as (port, _):
            more = (f"Origin: http://127.0.0.1:{port}", f"Sec-WebSocket-Key: {'x' * 22}==")
            for k in range(60):
                with socket.create_connection(("127.0.0.1", port)) as page:
                    page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                    page.sendall("\r\n".join([*lines, *more, "", ""]).encode())
                    if k % 2:
                        page.recv(4096)
        gc.collect()
    assert said.getvalue() == ""


@alone
def test_error_for_a_port_in_use_names_the_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ScenarioError, match=f"--port {port}: .*in use"):
            web.launch(port, False, [], [], Gamepad())


@alone
def test_simulation_time_does_not_advance_without_an_open_page(tmp_path):
    assert not play(load_scenario("straight_line"), tmp_path / "out", PlayOptions(seconds=1.0), lambda: False)
    assert not (tmp_path / "out").exists()


@alone
def test_rerun_of_a_saved_real_time_drive_reproduces_its_signals(tmp_path):
    options, pages = PlayOptions(seconds=3.0), ExitStack()
    with pages:
        ((folder, log),) = play(
            load_scenario("straight_line"),
            tmp_path / "out",
            options,
            lambda: False,
            lambda url: pages.enter_context(a_page(url)),
        )
    assert 1 <= log.signals.num_rows <= 61
    assert {path.name for path in folder.iterdir()} >= {"run.rrd", "signals.parquet", "inputs.csv", "metrics.json"}
    assert run(load_scenario(folder / "scenario.toml")).signals.equals(log.signals)


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_interrupt_saves_the_drive_and_ends_the_command(tmp_path):
    words = ["play", "straight_line", "--no-browser", "--no-rrd", "--json", "--out", str(tmp_path / "out")]
    command = subprocess.Popen(
        [sys.executable, "-m", "agrobot_mj", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    lines = []
    threading.Thread(target=lambda: lines.extend(iter(command.stderr.readline, "")), daemon=True).start()
    end = time.monotonic() + 120
    while not any("open http://127.0.0.1" in line for line in lines):
        assert command.poll() is None, lines
        assert time.monotonic() < end, lines
        time.sleep(0.1)
    with a_page(re.search(r"http://[\d.:]+/", lines[-1])[0]):
        time.sleep(1.0)
        command.send_signal(signal.SIGINT)
        out = command.stdout.read()
    assert command.wait(timeout=300) == 0
    (drive,) = json.loads(out)["drives"]
    assert drive["folder"] == str(tmp_path / "out")
    assert (tmp_path / "out" / "signals.parquet").is_file()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere"], "nowhere"),
        (["straight_line", "--set", "plant.kind=bicycle"], 'set plant.kind = "mujoco"'),
        (["straight_line", "--set", "terrain.grade_deg=80"], "terrain"),
    ],
)
def test_invalid_play_argument_gives_one_message_and_writes_no_folder(call, words, message, tmp_path):
    status, _, err = call("play", *words, "--no-browser", "--seconds", "0", "--out", str(tmp_path / "out"))
    assert status == 2
    assert message in err
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()
