"""Gamepad of the driver. The page reads the gamepad and sends its state to the server over a WebSocket."""

import json
import time
from collections import deque
from math import isfinite
from typing import Any

from agrobot_mj.extensions.play.driver import STALE_S, Keys

SOCKET = "/gamepad"  # URL path of the WebSocket
DEAD_ZONE = 0.08  # Deflection below which a stick or trigger counts as released [-]
MOST_CHARACTERS = 1000  # Maximum length of a message [characters]
BUTTONS = {0: "law", 1: "driver", 2: "stop", 3: "inject", 4: "mark", 5: "recall", 8: "restart", 9: "pause"}
"""Action of each button, by its number in the standard mapping of the Gamepad API: A, B, X, Y, both shoulder buttons,
Back and Start."""
SCRIPT = f"""<script>
addEventListener("gamepadconnected", () => {{
  const actions = {json.dumps(BUTTONS)};
  let socket, down;
  const connect = () => {{
    socket = new WebSocket(location.origin.replace("http", "ws") + "{SOCKET}");
    socket.onclose = () => setTimeout(connect, 2000);
  }};
  const poll = () => {{
    const pad = navigator.getGamepads().find((each) => each && each.mapping === "standard");
    if (!pad || socket.readyState !== WebSocket.OPEN) return;
    const value = (k) => pad.buttons[k] ? pad.buttons[k].value : 0;
    const held = Object.keys(actions).filter((k) => pad.buttons[k] && pad.buttons[k].pressed);
    const pressed = held.filter((k) => down && !down.includes(k)).map((k) => actions[k]);
    down = held;
    socket.send(JSON.stringify({{steer: -pad.axes[0], drive: value(7) - value(6), pressed}}));
  }};
  connect();
  setInterval(poll, 40);
}}, {{once: true}});
</script>
"""
"""Script that the page runs once a gamepad is connected. Browsers report a gamepad after the first press of a button,
which therefore has no action."""


class Gamepad:
    """Latest state of the driver's gamepad, as received from the web page."""

    def __init__(self) -> None:
        self.steer, self.drive, self.seen = 0.0, 0.0, -1e9
        self._pressed = deque[str](maxlen=len(BUTTONS))

    def receive(self, text: str | bytes) -> None:
        """Store the gamepad state in a message from the web page. Invalid messages are ignored."""
        try:
            given = json.loads(text[:MOST_CHARACTERS])
            steer, drive = _deflection(given["steer"]), _deflection(given["drive"])
            pressed = [str(name) for name in given["pressed"]]
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError):
            return
        self.steer, self.drive, self.seen = steer, drive, time.monotonic()
        self._pressed.extend(name for name in pressed if name in BUTTONS.values())

    def new_presses(self) -> list[str]:
        """Return the actions of the buttons that were pressed since the last call."""
        return [self._pressed.popleft() for _ in range(len(self._pressed))]

    def added_to(self, keys: Keys) -> Keys:
        """Return `keys` with the stick and triggers of the gamepad, or unchanged if the last message of the gamepad is
        older than `STALE_S`."""
        return keys._replace(stick=self.steer, pedal=self.drive) if self.seen > keys.seen - STALE_S else keys


def _deflection(value: Any) -> float:
    """Return the deflection of a stick or trigger from -1 to 1, or 0 in the dead zone. Raises ValueError or TypeError
    for invalid values."""
    number = float(value)
    if not isfinite(number):
        raise ValueError(number)
    return 0.0 if abs(number) < DEAD_ZONE else min(max(number, -1.0), 1.0)
