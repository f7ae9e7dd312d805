"""Headless Chromium, controlled by the DevTools protocol: real key and mouse events, and screenshots."""

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from contextlib import ExitStack
from pathlib import Path

import pytest
from websockets.sync.client import connect

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
GL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Options for software rendering on machines without a graphics card."""
CODES = {"ArrowUp": 38, "ArrowDown": 40, "ArrowLeft": 37, "ArrowRight": 39, "KeyL": 76, "KeyH": 72, "Space": 32}


class Browser:
    """Browser with one page."""

    def __init__(self, size=(1200, 800)):
        self.folder = tempfile.mkdtemp(prefix="play-browser-")
        flags = ["--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--remote-debugging-port=0"]
        more = [f"--window-size={size[0]},{size[1]}", f"--user-data-dir={self.folder}", *GL, "about:blank"]
        self.process = subprocess.Popen([CHROMIUM, *flags, *more], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.number = 0

    def __enter__(self):
        file, end = Path(self.folder) / "DevToolsActivePort", time.monotonic() + 60
        while not (file.exists() and file.read_text().strip()):
            assert time.monotonic() < end, "Chromium did not start"
            time.sleep(0.1)
        port = file.read_text().split()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
            page = next(each for each in json.load(answer) if each["type"] == "page")
        self.connected = ExitStack()
        self.socket = self.connected.enter_context(connect(page["webSocketDebuggerUrl"], max_size=2**26))
        return self

    def __exit__(self, *_):
        self.connected.close()
        self.process.kill()
        self.process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)

    def ask(self, method, **params):
        """Send a command of the DevTools protocol and return its result."""
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": params}))
        while True:
            answer = json.loads(self.socket.recv(timeout=120))
            if answer.get("id") == self.number:
                assert "result" in answer, answer
                return answer["result"]

    def open(self, url):
        self.ask("Page.navigate", url=url)

    def key(self, code, down):
        """Press or release a key of the keyboard."""
        name = code.removeprefix("Key").lower() if code.startswith("Key") else " " if code == "Space" else code
        kind = "keyDown" if down else "keyUp"
        self.ask("Input.dispatchKeyEvent", type=kind, key=name, code=code, windowsVirtualKeyCode=CODES[code])

    def hold(self, code, effect):
        """Hold a key until the function `effect` returns a value."""
        self.key(code, True)
        effect()
        self.key(code, False)

    def picture(self, path):
        """Write a screenshot of the page to a file."""
        path.write_bytes(base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"]))
