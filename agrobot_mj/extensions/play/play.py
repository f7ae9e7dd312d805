"""Interactive drives in a browser: simulation in real time, messages of the panel, and a results folder for each
drive."""

import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from math import degrees, isfinite, radians
from pathlib import Path
from typing import Any, NamedTuple

from mujoco.studio import messages, plugin

from agrobot_mj.core.errors import CommandError, ScenarioError
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.play import web
from agrobot_mj.extensions.play.adjustments import (
    ADJUSTMENTS,
    FAULT_S,
    NextStart,
    fault_kinds,
    restart_scenario,
    tyre_kind,
    tyre_kinds,
)
from agrobot_mj.extensions.play.driver import Keys, PlayDriver
from agrobot_mj.extensions.play.gamepad import Gamepad
from agrobot_mj.extensions.play.panel import SHOWN_S, CurvePoint, DrivePanel, HeldKeys, PlayStatus, Press, Restart
from agrobot_mj.extensions.play.session import PlaySession
from agrobot_mj.extensions.play.view import PlayView
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.results import check_folder, results
from agrobot_mj.simulation.storage import RECORDING, files_of_run, write_log

SHOW_S = 0.04  # Maximum time between two message exchanges with the viewer [s]
BEHIND_S = 0.25  # Maximum delay behind real time that a drive makes up [s]. Longer delays are reduced to this value.
CLOSE_S = 1.0  # Maximum time to wait for the viewer to exit after the files are written [s]
RATE_S = 1.0  # Time over which the ratio of simulated to wall-clock time is measured [s]


class PlayOptions(NamedTuple):
    """Options of `agrobot-mj play`."""

    port: int = 0
    network: bool = False  # Whether other computers can open the page
    seconds: float | None = None  # Wall-clock time after which the program ends [s], or None for no limit
    recorded: bool = True  # Whether each drive is recorded for Rerun


class Inbox(plugin.SimPlugin):  # type: ignore[misc, unused-ignore]
    """Storage of the messages that the simulation receives from the panel."""

    def __init__(self) -> None:
        self.presses: list[Press | Restart] = []
        self.keys = Keys()

    @messages.handler
    def on_press(self, press: Press) -> None:
        """Store a message about a pressed key, a button or a slider."""
        self.presses.append(press)

    @messages.handler
    def on_restart(self, restart: Restart) -> None:
        """Store a request to restart the drive."""
        self.presses.append(restart)

    @messages.handler
    def on_held(self, held: HeldKeys) -> None:
        """Store the currently pressed driving keys."""
        self.keys = held.keys


class Play:
    """Interactive drive: simulation, driver and view. Executes the requests of the panel."""

    def __init__(self, scenario: Scenario, keep: Callable[[PlaySession], Any]) -> None:
        """Prepare the first drive. The function `keep` writes the files of a finished drive, given as a session."""
        self.keep, self.paused = keep, False
        self.start(scenario)
        self.laws, self.faults, self.tyres = self.session.law_names, fault_kinds(), tyre_kinds()
        self.rate, self._measured = 1.0, (time.monotonic(), 0)

    def start(self, scenario: Scenario) -> None:
        """Create a drive with the tractor at the start of a scenario."""
        self.session = PlaySession(scenario)
        self.driver, self.view = PlayDriver(self.session), PlayView(self.session)
        self.curve: list[CurvePoint] = []

    def restart(self, settings: NextStart) -> None:
        """Save the current drive and start a new drive, or continue the drive if a setting is invalid."""
        before = self.session
        try:
            self.start(restart_scenario(before.base, settings))
        except ScenarioError as error:
            before.message = str(error)
        else:
            self.keep(before)

    def execute(self, press: Press | Restart) -> None:
        """Execute the request in a message from the panel. Messages with a value that is not finite are ignored."""
        if isinstance(press, Restart):
            self.restart(press.settings)
            return
        if not isfinite(press.value):  # a slider accepts "nan" as text
            return
        session, driver = self.session, self.driver
        actions: dict[str, Callable[[], Any]] = {
            "steer": lambda: driver.set_angle(radians(press.value)),
            "speed": lambda: driver.set_speed(press.value),
            "stop": driver.stop,
            "choose": lambda: self._choose(int(press.value)),
            "law": lambda: driver.hand_over(int(press.value)),
            "driver": driver.take_over,
            "mark": session.mark,
            "recall": self._recall,
            "inject": lambda: session.inject(press.text, FAULT_S),
            "pause": lambda: setattr(self, "paused", not self.paused),
            **{name: lambda: session.adjust(press.name, press.value) for name in ADJUSTMENTS},
        }
        actions[press.name]()

    def _choose(self, law: int) -> None:
        self.driver.chosen = law
        if self.driver.law:
            self.driver.hand_over(law)

    def _recall(self) -> None:
        self.session.recall()
        self.driver.recall()
        self.curve = [point for point in self.curve if point.t <= self.session.sim.truth.t]

    def tick(self, keys: Keys) -> None:
        """Advance the drive by one tick, and update the view and the curves."""
        self.driver.tick(keys)
        self.view.pose(self.session.sim)
        truth = self.session.sim.truth
        if not self.curve or truth.t > self.curve[-1].t:
            self.curve.append(CurvePoint(truth.t, self.session.cross_track(), degrees(truth.roll)))
        del self.curve[: -round(SHOWN_S / TICK_S)]

    def measure(self, now: float, ticks: int) -> None:
        """Update the ratio of simulated to wall-clock time at time `now` [s], after `ticks` simulated ticks."""
        since, before = self._measured
        if now - since >= RATE_S:
            self.rate, self._measured = (ticks - before) * TICK_S / (now - since), (now, ticks)

    def status(self) -> PlayStatus:
        """Return the message with the displayed state of the drive."""
        session, driver, truth = self.session, self.driver, self.session.sim.truth
        base = session.base
        return PlayStatus(
            title=f"{base.name}, {tyre_kind(base)}",
            laws=self.laws,
            faults=self.faults,
            tyres=self.tyres,
            t=truth.t,
            speed=truth.speed,
            wanted=driver.wanted_speed,
            angle=truth.steer if driver.law else driver.angle,
            roll=truth.roll,
            cross_track=self.curve[-1].cross_track if self.curve else 0.0,
            law=driver.law,
            chosen=driver.chosen,
            paused=self.paused,
            rate=self.rate,
            message=session.message,
            values=dict(session.values),
            grade=float(getattr(base.terrain, "grade_deg", 0.0)),
            tyre=self.tyres.index(tyre_kind(base)),
            pressure=base.tractor.tyre_pressure("rear", base.tractor.rear_axle_load / 2),
            curve=tuple(self.curve),
        )


def play(
    scenario: Scenario,
    folder: Path,
    options: PlayOptions,
    should_stop: Callable[[], bool],
    ready: Callable[[str], None] = lambda url: None,
) -> list[tuple[Path, Log]]:
    """Run interactive drives until `should_stop` returns True. Return the results folders and logs of all drives.

    Each drive has a separate results folder: `folder`, then `folder`-2, `folder`-3 and so on. `ready` is called with
    the address of the page. Raise `ScenarioError` for an unsuitable scenario or a port in use.
    """
    kept: list[tuple[Path, Log]] = []

    def keep(session: PlaySession, last: bool = False) -> None:
        if session.ticks and (session.driven or (last and not kept)):
            place = folder if not kept else _free(folder, len(kept) + 1, files_of_run(scenario))
            kept.append((place, save(session, place, options.recorded)))

    game, inbox, pad = Play(scenario, keep), Inbox(), Gamepad()
    panel = DrivePanel(lambda camera: game.view.aim(camera), pad)
    handle, viewer = web.launch(options.port, options.network, [panel], [inbox], pad)
    try:
        ready(f"http://{web.LOOPBACK}:{viewer.port}/")
        _loop(game, inbox, handle, viewer, options, should_stop)
    finally:
        closing = web.closing(handle)
    keep(game.session, last=True)
    closing.join(CLOSE_S)
    return kept


def _free(folder: Path, number: int, names: Sequence[str]) -> Path:
    """Return the first folder `folder`-`number`, `folder`-`number + 1` and so on to which a run can write its files."""
    while True:
        place = folder.with_name(f"{folder.name}-{number}")
        with suppress(ScenarioError):
            check_folder(place, names)
            return place
        number += 1


def _loop(
    game: Play,
    inbox: Inbox,
    handle: Any,
    viewer: web.PlayViewer,
    options: PlayOptions,
    should_stop: Callable[[], bool],
) -> None:
    """Advance the drive in real time or slower, and exchange messages with the viewer. Pause while no browser is
    connected."""
    began = due = time.monotonic()
    ticks = 0
    while not should_stop() and handle.is_running():
        now = time.monotonic()
        if options.seconds is not None and now - began >= options.seconds:
            break
        for press in inbox.presses[:]:
            with suppress(CommandError):
                game.execute(press)
        inbox.presses.clear()
        if waiting := game.paused or not viewer.clients:
            due = now
        elif now >= due:
            game.tick(inbox.keys.at(now))
            ticks += 1
            due = max(due + TICK_S, now - BEHIND_S)
        game.measure(now, ticks)
        handle.send_to_viewer(game.status())
        handle.sync(game.view.model, game.view.data)
        time.sleep(SHOW_S if waiting else min(max(due - time.monotonic(), 0.001), SHOW_S))


def save(session: PlaySession, folder: Path, recorded: bool) -> Log:
    """Write the files of a drive and return its log. Running the written scenario reproduces the drive."""
    from agrobot_mj.recording import Recording

    with tempfile.TemporaryDirectory() as place:
        log = session.finish(Path(place))
        scenario = log.scenario.changed({"expected_outcome": log.outcome})
        log = replace(log, scenario=scenario)
        with results(folder, files_of_run(scenario)):
            write_log(log, folder, recorded=False)
            if recorded:
                watcher = Recording(folder / RECORDING)
                watcher.start(scenario, log.scene, log.rows)
                watcher.advance(0)
                watcher.finish(log)
                write_log(log, folder)
    return log
