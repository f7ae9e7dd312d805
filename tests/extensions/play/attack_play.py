"""Hostile inputs for interactive driving: command options, recorded inputs, messages of the page, and its server."""

import io
import json
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import time
import urllib.request
from contextlib import redirect_stderr, suppress
from functools import cache
from math import inf, isfinite, nan
from pathlib import Path

from commands import bend
from hostile import BITS, NUMBERS, VALUES, bent, odd_lines
from judge import call
from processes import left, orphans
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from agrobot_mj import load_scenario
from agrobot_mj.core.errors import CommandError
from agrobot_mj.extensions.play import web
from agrobot_mj.extensions.play.adjustments import ADJUSTMENTS, NextStart, fault_kinds, tyre_kinds
from agrobot_mj.extensions.play.driver import Keys
from agrobot_mj.extensions.play.gamepad import SOCKET, Gamepad
from agrobot_mj.extensions.play.panel import PRESSED, Press, Restart
from agrobot_mj.extensions.play.play import Play, save
from agrobot_mj.simulation.run import run

SETTLED = {"plant.settle_s": 0.1, "plant.settle_limit_s": 1.0}
COMMAND = "play straight_line --port 0 --seconds 0 --no-browser --no-rrd --set plant.settle_s=0.1 --out out".split()
ODD = (nan, inf, -inf, 0.0, -1.0, 1.0, 0.5, 3.0, 1e9, 1e308, -1e308, 5e-324)
NAMES = (*(PRESSED.keys() - {"restart", "law"}), *ADJUSTMENTS, "steer", "speed")
"""Names of the messages of the panel that contain no number of a guidance law."""
TICKS = 15
PATIENCE_S = 30.0  # Maximum time until the server replies, on a busy machine [s]


@cache
def scenario():
    """Return a scenario in which the tractor settles within a second."""
    return load_scenario("straight_line", SETTLED)


def prepare() -> None:
    """Compile the kernels of a short interactive drive."""
    Play(scenario(), lambda session: None).tick(Keys())


def _messages(chance: random.Random) -> str:
    """Send random messages of the panel during a drive. The saved scenario must reproduce the drive."""
    game = Play(scenario(), lambda session: None)
    for _ in range(TICKS):
        for _ in range(chance.randrange(4)):
            game.execute(_message(chance)) if chance.random() < 0.9 else _refused(chance, game)
        game.tick(Keys(*(chance.random() < 0.3 for _ in range(4)), time.monotonic(), *chance.choices(ODD[3:8], k=2)))
        status = game.status()
        numbers = (status.t, status.speed, status.wanted, status.angle, status.roll, status.cross_track)
        if not all(map(isfinite, numbers)):
            return f"the status contains {numbers}"
    log = save(game.session, Path("out"), recorded=False)
    again = run(load_scenario(Path("out") / "scenario.toml"))
    return "" if again.signals.equals(log.signals) else "the saved scenario does not reproduce the drive"


def _message(chance: random.Random) -> Press | Restart:
    if chance.random() < 0.05:
        return Restart(NextStart(chance.choice(ODD), chance.choice(["", *tyre_kinds(), "nope"]), chance.choice(ODD)))
    return Press(chance.choice(sorted(NAMES)), chance.choice(ODD), chance.choice([*fault_kinds(), "", "nope"]))


def _refused(chance: random.Random, game: Play) -> None:
    """Send a message with the number of a guidance law that may not exist."""
    try:
        game.execute(Press(chance.choice(["choose", "law"]), chance.choice([-1.0, 0.0, 1.0, 2.0, 1e6])))
    except CommandError:
        return


def _inputs(chance: random.Random) -> str:
    """Run the scenario of a drive with damaged inputs."""
    game = Play(scenario(), lambda session: None)
    for k in range(5):
        game.execute(Press("speed", 0.5 * k))
        game.tick(Keys(left=k > 2, seen=time.monotonic()))
    save(game.session, Path("run"), recorded=False)
    file = Path("run") / "inputs.csv"
    changed = odd_lines(chance, file) if chance.random() < 0.5 else bent(chance, file.read_bytes(), 3)
    file.write_bytes(changed)
    return call(["run", "run/scenario.toml", "--no-rrd", "--quiet", "--out", "out"])


def _gamepad(chance: random.Random) -> str:
    """Send random messages to the gamepad. Its deflections must stay between -1 and 1."""
    pad = Gamepad()
    for _ in range(200):
        text = _pad_message(chance)
        pad.receive(text.encode(errors="replace") if chance.random() < 0.3 else text)
        pad.new_presses()
        if not (abs(pad.steer) <= 1 and abs(pad.drive) <= 1):
            return f"{text[:200]!r} gives {pad.steer}, {pad.drive}"
    return ""


def _pad_message(chance: random.Random) -> str:
    odd = [*NUMBERS, *VALUES, '"x"', "null", '["law"]', "NaN", "[" * 3000]
    steer, drive, pressed = (chance.choice(odd) for _ in range(3))
    good = json.dumps({"steer": chance.choice(ODD), "drive": 0.5, "pressed": ["law", "nope"]})
    return chance.choice([good, f'{{"steer": {steer}, "drive": {drive}, "pressed": {pressed}}}', chance.choice(odd)])


def server(chance: random.Random) -> str:
    """Send hostile requests and frames to the server of the page, which must reply afterwards."""
    handle, viewer = web.launch(0, False, [], [], Gamepad())
    if found := _reply(viewer.port):
        return found
    with redirect_stderr(io.StringIO()) as said:
        for _ in range(12):
            chance.choice([_requests, _frames, _raw, _raw, _crowd])(chance, viewer.port)
        found = _reply(viewer.port) or _pages_left(viewer)
        web.closing(handle).join(PATIENCE_S)
    return found or said.getvalue()


def _pages_left(viewer: web.PlayViewer) -> str:
    """Return an empty text as soon as the viewer counts no page, otherwise a message. A drive pauses without a page."""
    end = time.monotonic() + PATIENCE_S
    while viewer.clients and time.monotonic() < end:
        time.sleep(0.05)
    return f"{viewer.clients} pages are counted after the end of all connections" if viewer.clients else ""


def _reply(port: int) -> str:
    """Return an empty text as soon as the server sends its page, or a description of the fault."""
    end, error = time.monotonic() + PATIENCE_S, ""
    while time.monotonic() < end:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=PATIENCE_S) as page:
                return "" if page.status == 200 else f"status {page.status}"
        except OSError as refused:
            error = str(refused)
            time.sleep(0.05)
    return f"the server does not reply: {error}"


def _requests(chance: random.Random, port: int) -> None:
    """Send a malformed or unusual HTTP request."""
    paths = (
        "/",
        "/../../etc/passwd",
        "//x",
        "/model?crc32=x",
        "/%00",
        f"/{'x' * 5000}",
        "/state",
        "\xff",
        "*",
        "/drop",
    )
    method = chance.choice(["GET", "POST", "get", "", "OPTIONS", "GET" * 3000])
    lines = [f"{method} {chance.choice(paths)} HTTP/1.1", "Host: x", f"Content-Length: {chance.choice(NUMBERS)}"]
    request = bytearray("\r\n".join([*lines, "", ""]).encode(errors="replace"))
    if chance.random() < 0.5:
        request[chance.randrange(len(request)) :] = chance.choice([*BITS, chance.randbytes(300)])
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as sent:
        sent.sendall(request)


def _frames(chance: random.Random, port: int) -> None:
    """Open a WebSocket of the page and send messages with random content."""
    path = chance.choice([SOCKET, SOCKET, web.STATE, "/drop", "/nope", f"{SOCKET}?x"])
    origin = chance.choice([f"http://127.0.0.1:{port}", f"http://127.0.0.1:{port}", "http://example.org", None])
    texts = ("heartbeat", "state_ack", "max_spectators=999", "max_spectators=x", "theme=nope", "request_control", "x")
    try:
        with connect(f"ws://127.0.0.1:{port}{path}", origin=origin, open_timeout=PATIENCE_S, close_timeout=1) as page:
            for _ in range(chance.randrange(8)):
                text = chance.choice([*texts, _pad_message(chance)]).encode(errors="replace").decode()
                page.send(chance.choice([text, chance.randbytes(chance.choice([0, 3, 200])), _header(chance)]))
    except (OSError, WebSocketException):
        return


def _raw(chance: random.Random, port: int) -> None:
    """Open a WebSocket of the page without a library, send malformed frames, and close or reset the connection."""
    path = chance.choice([SOCKET, web.STATE, "/ui", "/drop"])
    key = chance.choice(["dGhlIHNhbXBsZSBub25jZQ==", "dGhlIHNhbXBsZSBub25jZQ==", "", "x"])
    lines = [f"GET {path} HTTP/1.1", f"Host: 127.0.0.1:{port}", "Upgrade: websocket", "Connection: Upgrade"]
    lines += [f"Origin: http://127.0.0.1:{port}", f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13"]
    request = "\r\n".join([*lines, "", ""]).encode()
    sent = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
    with sent, suppress(OSError):
        if chance.random() < 0.5:
            sent.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # reset instead of close
        sent.sendall(request[: len(request) if chance.random() < 0.9 else chance.randrange(len(request))])
        if chance.random() < 0.7:
            sent.settimeout(1.0)
            sent.recv(4096)
        for _ in range(chance.randrange(5)):
            sent.sendall(_frame(chance))
            time.sleep(chance.choice([0.0, 0.0, 0.05]))


def _frame(chance: random.Random) -> bytes:
    """Return a WebSocket frame with a random type and content, whose length may be wrong."""
    size = chance.choice([0, 1, 2, 125, 126, 5000, 70_000, 20_000_000])
    content = chance.choice([b"state_ack", b"request_control", b"\xff" * size, bytes(size), b"[" * size, b"9" * size])
    length = chance.choice([len(content)] * 6 + [0, 3, 2**31, 2**63 - 1])
    masked = 0x80 if chance.random() < 0.9 else 0
    start = bytes([chance.choice([0x81, 0x82, 0x81, 0x01, 0x80, 0x88, 0x89, 0x8A, 0x83, 0xC1, 0xFF])])
    if length < 126:
        start += bytes([masked | length])
    else:
        start += bytes([masked | 127]) + struct.pack(">Q", length)
    return start + bytes(4 if masked else 0) + content


def _crowd(chance: random.Random, port: int) -> None:
    """Open many connections at once, which send nothing, an incomplete request, or a complete request."""
    request = chance.choice([b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"])
    connected = [socket.create_connection(("127.0.0.1", port), PATIENCE_S) for _ in range(chance.choice([10, 200]))]
    for each in connected:
        with each, suppress(OSError):
            each.sendall(request)


def _header(chance: random.Random) -> bytes:
    """Return bytes that begin with a number of bytes that do not follow."""
    return struct.pack("<I", chance.choice([0, 1, 2**31, 2**32 - 1])) + b"x.xml"


def _options(chance: random.Random) -> str:
    """Run the command with one to three erroneous options."""
    words = list(COMMAND)
    for _ in range(chance.randint(1, 3)):
        bend(chance, words)
    return call(words) if "--seconds" in words else ""


def play(chance: random.Random) -> str:
    """Drive with hostile options, inputs, panel messages, or gamepad messages."""
    return chance.choices((_options, _inputs, _messages, _gamepad), (3, 3, 3, 1))[0](chance)


DRIVE = "-m agrobot_mj play straight_line --no-browser --no-rrd --set plant.settle_s=0.1 --out out".split()


def starts(chance: random.Random) -> str:
    """Interrupt or end the command during its start, possibly twice, or start the command on a port in use."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port, used = taken.getsockname()[1], chance.random() < 0.3
        taken.listen() if used else taken.close()
        words = [*DRIVE, "--port", str(port), *([] if used else ["--network"] if chance.random() < 0.2 else [])]
        options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "start_new_session": True}
        process = subprocess.Popen([sys.executable, *words], **options)
        number = chance.choice([signal.SIGINT, signal.SIGTERM])
        if not used:
            time.sleep(chance.uniform(0.0, chance.choice([3.0, 15.0])))
            for pause in (0.0, chance.uniform(0.0, 0.3))[: chance.choice([1, 1, 2])]:
                time.sleep(pause)
                process.send_signal(number)
        try:
            said = process.communicate(timeout=2 * PATIENCE_S)[1].decode(errors="replace")
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return f"no end {2 * PATIENCE_S:g} s after {number.name}"
    if used and (process.returncode != 2 or f"--port {port}: " not in said or Path("out").exists()):
        return f"port in use: status {process.returncode}: {said}"
    found = "" if used else left(number, said, process.returncode)
    return found or orphans(process.pid) or ("results without a page" if Path("out").exists() else "")


CLASSES = {"play": (play, 0.06, prepare), "server": (server, 0.01), "starts": (starts, 0.01)}
