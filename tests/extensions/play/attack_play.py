"""Hostile inputs for interactive driving: command options, recorded inputs, messages of the page, and its server."""

import json
import random
import socket
import struct
import time
import urllib.request
from functools import cache
from math import inf, isfinite, nan
from pathlib import Path

from commands import bend
from hostile import BITS, NUMBERS, VALUES, bent, odd_lines
from judge import call
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
        pad.pressed()
        if not (abs(pad.steer) <= 1 and abs(pad.drive) <= 1):
            return f"{text[:200]!r} gives {pad.steer}, {pad.drive}"
    return ""


def _pad_message(chance: random.Random) -> str:
    odd = [*NUMBERS, *VALUES, '"x"', "null", '["law"]', "NaN", "[" * 3000]
    steer, drive, pressed = (chance.choice(odd) for _ in range(3))
    good = json.dumps({"steer": chance.choice(ODD), "drive": 0.5, "pressed": ["law", "nope"]})
    return chance.choice([good, f'{{"steer": {steer}, "drive": {drive}, "pressed": {pressed}}}', chance.choice(odd)])


def _server(chance: random.Random) -> str:
    """Send hostile requests and frames to the server of the page, which must reply afterwards."""
    handle, viewer = web.launch(0, False, [], [], Gamepad())
    if found := _reply(viewer.port):
        return found
    for _ in range(12):
        if chance.random() < 0.5:
            _requests(chance, viewer.port)
        else:
            _frames(chance, viewer.port)
    found = _reply(viewer.port)
    web.closing(handle).join(PATIENCE_S)
    return found


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
    """Drive with hostile options, inputs, panel messages, gamepad messages, or requests to the server."""
    return chance.choices((_options, _inputs, _messages, _gamepad, _server), (3, 3, 3, 1, 1))[0](chance)


CLASSES = {"play": (play, 0.06, prepare)}
