"""Interactive drive without a viewer: simulation with driver inputs, adjustments, faults, and result files.

Each adjustment of the machine or the ground is recorded in the scenario as a fault that starts at the next tick.
Therefore the saved scenario reproduces the drive.
"""

from collections.abc import Mapping
from math import cos, hypot, nan, sin
from pathlib import Path
from typing import Any, NamedTuple

from agrobot_mj.core.errors import CommandError, ScenarioError
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.play.adjustments import ADJUSTMENTS
from agrobot_mj.extensions.play.continuing import continue_run
from agrobot_mj.extensions.play.inputs import INPUTS, PlayInput, write_inputs
from agrobot_mj.extensions.play.played import Played, PlayState, nearest_time
from agrobot_mj.scenario.reference import families
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.snapshot import Snapshot
from agrobot_mj.simulation.stepping import Simulation

LONGEST_S = 3600.0  # Maximum duration of a drive [s]


class Mark(NamedTuple):
    """Saved state of a drive, to which the driver can return."""

    state: Snapshot
    given: PlayInput
    open_faults: dict[str, int]
    values: dict[str, float]


class PlaySession:
    """Simulation of an interactive drive from the start of a scenario."""

    def __init__(self, scenario: Scenario) -> None:
        """Place the tractor at the start of a scenario. Raise `ScenarioError` if the scenario is unsuitable for
        interactive drives."""
        self.base = scenario
        self.sim = Simulation(drivable(scenario))
        self.law_names = [table["kind"] for table in self.played.laws]
        self.given = PlayInput()
        self.values = {name: each.neutral for name, each in ADJUSTMENTS.items()}
        self.message = ""
        self._changes: list[tuple[int, PlayInput]] = []
        self._open: dict[str, int] = {}
        self._before: Snapshot | None = None
        self._mark: Mark | None = None
        self.sim.reset()

    @property
    def played(self) -> Played:
        """Guidance law `played` of this drive."""
        guidance = self.sim.scenario.guidance
        assert isinstance(guidance, Played)
        return guidance

    @property
    def ticks(self) -> int:
        """Number of simulated ticks since the start of the drive."""
        return self.sim.rows.filled

    @property
    def driven(self) -> bool:
        """Whether a guidance law was active or a nonzero speed was commanded during the drive."""
        return any(given.law or given.speed for _, given in self._changes)

    def tick(self) -> None:
        """Advance the simulation by one tick with the current input, unless the run has ended.

        If a guidance law raises an exception, the tractor stops and the driver takes over. The attribute `message` then
        contains the reason.
        """
        if self.sim.done:
            return
        before, state = self.sim.save(), self.sim.loop.stages.guidance
        assert isinstance(state, PlayState)
        try:
            self.sim.drive(state._replace(given=self.given))
        except Exception as error:
            if not self.given.law:
                raise
            self.message = f"{self.law_names[self.given.law - 1]}: {error}"
            self.sim, self.given = continue_run(before, before.scenario), PlayInput()
            return
        if not self._changes or self._changes[-1][1] != self.given:
            self._changes.append((before.rows.filled, self.given))
        self._before = before
        if self.sim.done:
            self.message = f"{self.sim.outcome}: {self.sim.reason}" if self.sim.reason else self.sim.outcome

    def steer(self, angle: float, speed: float) -> None:
        """Set the driver's steering angle [rad] and speed [m/s]."""
        limit = self.base.tractor.steer_limit
        self.given = PlayInput(0, min(max(angle, -limit), limit), speed)

    def hand_over(self, law: int, speed: float = nan) -> None:
        """Hand control over to the guidance law with the number `law`, counted from 1.

        `speed` is the speed setpoint of the law [m/s], or NaN for the speed of the path.
        """
        if not 1 <= law <= len(self.law_names):
            raise CommandError(f"law: must be from 1 to {len(self.law_names)}, got {law}")
        self.given = PlayInput(law, 0.0, speed)

    def adjust(self, name: str, value: float) -> None:
        """Set the quantity `name` of `ADJUSTMENTS` to a value that applies from the next tick."""
        faults = ADJUSTMENTS[name].faults(value)
        if self._script([name], [(f"{name}.{k}", fault, None) for k, fault in enumerate(faults)]):
            self.values[name] = value

    def inject(self, kind: str, seconds: float) -> None:
        """Inject a fault of the given kind with default parameters at the next tick, for a duration of `seconds`."""
        if self._script([], [("", {"kind": kind}, seconds)]):
            self.message = f"{kind} for {seconds:g} s"

    def _script(self, ended: list[str], begun: list[tuple[str, dict[str, Any], float | None]]) -> bool:
        """End the faults of the quantities `ended` and start the faults `begun` at the next tick. Return whether this
        succeeds. If the scenario is invalid, the drive is unchanged and `message` has the reason."""
        if self.sim.done:
            return False
        now = (self.ticks + 1) * TICK_S
        faults = [fault.model_dump(mode="json", exclude_none=True) for fault in self.sim.scenario.fault]
        still = dict(self._open)
        for name in [each for each in still if each.partition(".")[0] in ended]:
            faults[still.pop(name)]["end_s"] = round(now, 9)
        faults, still = _without_empty(faults, still)
        for name, fault, seconds in begun:
            if name:
                still[name] = len(faults)
            end = {} if seconds is None else {"end_s": round(now + max(round(seconds / TICK_S), 1) * TICK_S, 9)}
            faults.append({**fault, "start_s": round(now, 9), **end})
        try:
            scenario = self.sim.scenario.changed({"fault": faults})
            self.sim = continue_run(self.sim.save(), scenario)
        except (ScenarioError, CommandError) as error:
            self.message = str(error)
            return False
        self._open = still
        return True

    def mark(self) -> None:
        """Save the current state of the drive, so that the driver can return to it."""
        self._mark = Mark(self.sim.save(), self.given, dict(self._open), dict(self.values))
        self.message = f"state at {self.sim.truth.t:.1f} s kept"

    def recall(self) -> None:
        """Restore the saved state, and discard the part of the drive after this state."""
        if self._mark is None:
            self.message = "no state has been kept"
            return
        state, self.given, open_faults, values = self._mark
        self.sim = continue_run(state, state.scenario)
        self._open, self.values = dict(open_faults), dict(values)
        self._changes = [(tick, given) for tick, given in self._changes if tick < self.ticks]
        self._before = None
        self.message = f"back at {self.sim.truth.t:.1f} s"

    def cross_track(self) -> float:
        """Return the cross-track error of the CG [m], positive to the left of the path."""
        truth, route = self.sim.truth, self.sim.path
        r = route.at(nearest_time(route, truth.x, truth.y, self.played.search_s))
        side = -sin(r.yaw) * (truth.x - r.x) + cos(r.yaw) * (truth.y - r.y)
        return hypot(truth.x - r.x, truth.y - r.y) * (1.0 if side >= 0 else -1.0)

    def finish(self, folder: Path) -> Log:
        """Write the driver inputs to a folder. Return the log with a scenario that reproduces the drive.

        The last tick is simulated again with the written inputs, so that the drive and its reproduction end
        identically.
        """
        write_inputs(folder / INPUTS, self._changes)
        before = self._before if self._before is not None else self.sim.save()
        scenario = _repeating(self.sim.scenario, folder / INPUTS, max(self.ticks, 1))
        sim = continue_run(before, scenario)
        while not sim.done:
            sim.step()
        return sim.log(self.ticks * TICK_S)


def drivable(scenario: Scenario) -> Scenario:
    """Return the scenario with guidance by a driver, who can hand over to all suitable guidance laws.

    Raise `ScenarioError` for a plant without a 3D model or for external guidance.
    """
    if scenario.plant.kind != "mujoco":
        raise ScenarioError(f'plant.kind: "{scenario.plant.kind}" has no 3D model to show; set plant.kind = "mujoco"')
    if scenario.guidance.outside and not isinstance(scenario.guidance, Played):
        command = scenario.guidance.outside
        raise ScenarioError(f'guidance.kind: "{scenario.guidance.kind}" needs `agrobot-mj {command}`')
    keys = {"kind": "played", "laws": laws_of(scenario), "search_s": scenario.path.turns_s[0][1]}
    return scenario.changed({"guidance": keys, "duration_s": LONGEST_S, "expected_outcome": "unfinished"})


def laws_of(scenario: Scenario) -> list[dict[str, Any]]:
    """Return the tables of all guidance laws that are valid for a scenario, starting with the law of the scenario."""
    own = scenario.guidance
    if isinstance(own, Played):
        return list(own.laws)
    found = [own.model_dump(mode="json", exclude_none=True)]
    for kind, law in families()["guidance"].items():
        if kind == own.kind or issubclass(law, Played):
            continue
        try:
            guidance = scenario.changed({"guidance": {"kind": kind}}).guidance
        except ScenarioError:  # the law needs a sensor or a file that the scenario lacks
            continue
        if not guidance.outside:
            found.append(guidance.model_dump(mode="json", exclude_none=True))
    return found


def _without_empty(
    faults: list[dict[str, Any]], still: Mapping[str, int]
) -> tuple[list[dict[str, Any]], dict[str, int]]:
    """Return the faults with a positive duration, and the indices of the faults `still` in this list."""
    kept = [k for k, fault in enumerate(faults) if fault.get("end_s", fault["start_s"] + 1.0) > fault["start_s"]]
    return [faults[k] for k in kept], {name: kept.index(k) for name, k in still.items()}


def _repeating(scenario: Scenario, inputs: Path, ticks: int) -> Scenario:
    """Return the scenario that reproduces a drive of `ticks` ticks with the inputs in a file."""
    end = ticks * TICK_S
    faults = [
        fault.model_dump(mode="json", exclude_none=True) for fault in scenario.fault if fault.start_s < end - TICK_S / 2
    ]
    guidance = {
        **scenario.guidance.model_dump(mode="json", exclude_none=True),
        "inputs": {"file": str(inputs.absolute())},
    }
    return scenario.changed({"guidance": guidance, "duration_s": round(end, 9), "fault": faults})
