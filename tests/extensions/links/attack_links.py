"""Hostile datagrams for the boards, for the host, and for a session without sockets."""

import random
from functools import cache, reduce
from operator import xor

from guide import Guide, GuideState, HostSettings

from agrobot_mj import load_scenario
from agrobot_mj.core.agopengps.wire import decode, frame
from agrobot_mj.extensions.links.agopengps.board import Board
from agrobot_mj.extensions.links.agopengps.link import run_link
from agrobot_mj.extensions.links.agopengps.session import LinkOptions
from agrobot_mj.extensions.links.agopengps.udp import Incoming
from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps

SENTENCE = b"$PANDA,120000.0,5052.62,N,00441.94,E,4,12,0.7,40.0,0.2,1.5,90.0,0.1,0.0,0.0*00\r\n"
PIECES = (b"nan", b"-", b"1e999", b"\xff\xfe", b",,", b"*", b"9" * 400, b"S", b"\x00", b"\r\n", b"$")
NUMBERS = (254, 252, 251, 200, 202, 253, 100, 0)  # Message numbers, most of which are defined by the protocol


class Hostile:
    """Connection on which a host replies and other programs send hostile datagrams."""

    pace = None

    def __init__(self, chance: random.Random, guide: Guide) -> None:
        self.chance, self.guide, self.state, self.turn = chance, guide, GuideState(), 0
        self.answers: list[bytes] = []

    def begin(self, turn: int):
        """Return hostile datagrams that arrive before a turn."""
        self.turn = turn
        return self._incoming(hostile(self.chance) for _ in range(self.chance.randrange(4)))

    def rest(self, turn: int, answered):
        """Return the replies of the host in random order, possibly repeated, together with a hostile datagram."""
        answers, self.answers = [*self.answers, hostile(self.chance)], []
        answers += answers[: self.chance.randrange(2)]
        self.chance.shuffle(answers)
        return self._incoming(answers)

    def _incoming(self, messages):
        return (Incoming(self.turn * 0.05, "127.0.0.1:9999", message) for message in messages)

    def send(self, data: bytes, target=None):
        """Pass a datagram to the host, and sometimes a hostile datagram instead."""
        bent = hostile(self.chance) if self.chance.random() < 0.1 else data
        self.state, answers = self.guide.receive(self.state, bent, self.turn * 0.05)
        self.answers += answers
        return self.turn * 0.05, "127.0.0.1:9999"


def hostile(chance: random.Random) -> bytes:
    """Return bytes that resemble a message: noise, or frames and sentences with a correct or wrong checksum."""
    kind = chance.randrange(5)
    if kind == 0:
        return chance.randbytes(chance.choice([0, 1, 5, 20, 70, 1500]))
    if kind == 1:
        return frame(chance.randrange(256), chance.choice(NUMBERS), chance.randbytes(chance.randrange(20)))
    if kind == 2:
        message = bytearray(frame(127, 254, chance.randbytes(8)))
        message[chance.randrange(len(message))] ^= 1 << chance.randrange(8)
        return bytes(message)
    words = SENTENCE.split(b",")
    for _ in range(chance.randint(1, 3)):
        words[chance.randrange(len(words))] = chance.choice(PIECES)
    text = b",".join(words)
    body = text[1:].partition(b"*")[0]
    return text if kind == 3 else b"$%b*%02X\r\n" % (body, reduce(xor, body, 0))


@cache
def guide() -> Guide:
    """Return the host of the example program."""
    return Guide(HostSettings())


def datagrams(chance: random.Random) -> str:
    """Send 200 messages to the parser, the board and the host, or run a session of one second with hostile
    datagrams."""
    if chance.random() < 0.3:
        keys = {"guidance.kind": "agopengps", "plant.kind": "bicycle", "duration_s": 1.0}
        options = LinkOptions(start=chance.choice(["heard", "now", "engaged"]), wait_s=0.5)
        try:
            log = run_link(load_scenario("straight_line", keys), Hostile(chance, guide()), options).log
        except Exception as error:
            return "" if type(error).__name__ == "NoHostError" else f"{type(error).__name__}: {error}"
        return "" if log.outcome in ("completed", "host_lost", "not_engaged") else f"{log.outcome}: {log.metrics}"
    board, host = Board(AgOpenGps(), 0.78, True), GuideState()
    state = board.init()
    for k in range(200):
        message = hostile(chance)
        decode(message)
        state, _ = board.receive(state, message, k * 0.05, k * 0.05, chance.random() < 0.5)
        state, actuation = board.tick(state, k * 0.05, 0.1)
        if not abs(actuation.steer) <= 0.78:
            return f"{message!r} steers to {actuation.steer}"
        host, answers = guide().receive(host, message, k * 0.05)
        for answer in answers:
            decode(answer)
    return ""


CLASSES = {"datagrams": (datagrams, 0.06, guide)}
