"""Real key events in a headless browser: manual driving, handover to a law, and a rollover on a slope."""

import threading
import time

import pytest
from browser import Browser, needs_browser

from agrobot_mj.extensions.play import play as playing
from agrobot_mj.extensions.play.play import Play, PlayOptions, play
from agrobot_mj.scenario.loading import load_scenario

PATIENCE_S = 240.0
"""Maximum wait for the effect of a key [s]. On a loaded machine, software rendering takes seconds per frame."""


@pytest.fixture
def game(tmp_path, monkeypatch):
    """Yield a function that starts a drive and a browser, and returns both once the page is displayed."""
    stop, pages, games, threads = threading.Event(), [], [], []
    loop = playing._loop

    def watched(game, *others):
        games.append(game)
        loop(game, *others)

    monkeypatch.setattr(playing, "_loop", watched)

    def start(keys):
        scenario = load_scenario("side_slope_10", keys)
        options = PlayOptions(recorded=False)
        drive = threading.Thread(target=play, args=(scenario, tmp_path / "out", options, stop.is_set, pages.append))
        drive.start()
        threads.append(drive)
        until(lambda: pages and games)
        return games[0], pages[0]

    yield start
    stop.set()
    for thread in threads:
        thread.join()


def until(condition):
    """Wait until a condition holds."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


@needs_browser
@pytest.mark.slow
def test_browser_keys_can_steer_select_laws_and_cause_a_rollover(game):
    drive: Play
    drive, page = game({"terrain.grade_deg": 25.0})
    with Browser((640, 400)) as browser:
        browser.open(page)
        until(lambda: drive.session.ticks)
        sim = drive.session.sim
        browser.hold("ArrowUp", lambda: until(lambda: drive.driver.speed > 0.6))
        until(lambda: sim.truth.speed > 0.4)
        assert sim.truth.x > 0.0
        browser.hold("KeyL", lambda: until(lambda: drive.session.given.law == 1))
        browser.hold("KeyH", lambda: until(lambda: drive.driver.law == 0))
        browser.key("ArrowUp", True)
        browser.key("ArrowRight", True)
        until(lambda: sim.done)
    assert sim.outcome == "rolled_over"


PAD = """
const buttons = Array.from({length: 16}, () => ({value: 0, pressed: false}));
window.pad = {mapping: "standard", axes: [0, 0, 0, 0], buttons};
navigator.getGamepads = () => [null, window.pad];
dispatchEvent(new Event("gamepadconnected"));
"""


@needs_browser
@pytest.mark.slow
def test_gamepad_in_the_browser_steers_and_selects_a_law(game):
    drive: Play
    drive, page = game({})
    with Browser((640, 400)) as browser:
        browser.open(page)
        until(lambda: drive.session.ticks)
        browser.ask("Runtime.evaluate", expression=PAD)
        browser.ask("Runtime.evaluate", expression="pad.axes[0] = -0.5; pad.buttons[7].value = 1")
        until(lambda: drive.driver.speed > 0.6)
        assert drive.driver.angle == pytest.approx(0.5 * drive.session.base.tractor.steer_limit)
        browser.ask("Runtime.evaluate", expression="pad.axes[0] = 0; pad.buttons[7].value = 0")
        browser.ask("Runtime.evaluate", expression="pad.buttons[0].pressed = true")
        until(lambda: drive.session.given.law == 1)
        browser.ask("Runtime.evaluate", expression="pad.axes[0] = 0.9")
        until(lambda: drive.session.given.law == 0 and drive.driver.angle < 0.0)
