"""Guidance law `played`: guidance by a human driver, and by guidance laws to which the driver hands over control.

`agrobot-mj play` sets the input of each tick. With `inputs.file`, the inputs are read from a table, which reproduces an
earlier drive. A law that takes over starts at the point of the path nearest to the tractor. The time on the path starts
at this point and advances at the commanded speed divided by the path speed.
"""

from collections.abc import Sequence
from math import hypot, inf, isnan
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field, PrivateAttr, ValidationError, field_validator

from agrobot_mj.control.base import GuidanceLaw, Route, Situation, YawController
from agrobot_mj.control.pid import clip
from agrobot_mj.core.errors import suggestion
from agrobot_mj.core.geometry import to_heading
from agrobot_mj.core.signals import TICK_S, Column, Command
from agrobot_mj.core.spec import HUGE, Spec
from agrobot_mj.extensions.play.inputs import PlayInput, read_inputs

COARSE_S, FINE_S = 1.0, 0.05  # Steps of the search for the nearest point of the path [s]
LEAST_SPEED_M_S = 0.05  # Path speed below which the time on the path advances in real time [m/s]


class PlayState(NamedTuple):
    """State of the guidance law `played`."""

    given: PlayInput = PlayInput()  # Input of the current tick
    law: int = 0  # Number of the guidance law to which `inner` belongs, counted from 1, or 0 for the driver
    inner: Any = None  # State of the guidance law with the number `law`
    time: float = 0.0  # Time on the path of the active guidance law [s]


class PlayRecord(Spec):
    """Recorded driver inputs of an earlier drive."""

    file: str | None = None
    """CSV file (`inputs.csv`) with inputs of an earlier drive. Default: none; `agrobot-mj play` provides inputs."""


class Played(GuidanceLaw):
    """Guidance by a driver in `agrobot-mj play`, and by laws that take over."""

    kind: Literal["played"] = "played"
    timed: ClassVar = False
    inputs: PlayRecord = PlayRecord()
    """Recorded inputs of an earlier drive, which is reproduced."""
    laws: tuple[dict[str, Any], ...] = ()
    """Guidance laws that can take over, as tables with a `kind`. In the inputs, laws are numbered from 1."""
    search_s: Annotated[float, Field(gt=0, le=HUGE)] = 120.0
    """Duration of the path, from its start, that is searched for the nearest point [s]. Default: one lap of the paper's
    path. `agrobot-mj play` sets this key to the duration of the first lap."""
    _members: tuple[GuidanceLaw, ...] = PrivateAttr(())

    @field_validator("laws")
    @classmethod
    def _check_laws(cls, laws: tuple[dict[str, Any], ...]) -> tuple[dict[str, Any], ...]:
        for k, table in enumerate(laws):
            law_of(table, f"laws[{k}]")
        return laws

    @property
    def members(self) -> tuple[GuidanceLaw, ...]:
        """Guidance laws that can take over, as objects."""
        return self._members or tuple(law_of(table, f"laws[{k}]") for k, table in enumerate(self.laws))

    @property
    def needs(self) -> dict[str, str]:
        """Sensors that the guidance laws require, with the reason for each sensor."""
        return {sensor: f"laws: {text}" for law in self.members for sensor, text in law.needs.items()}

    @property
    def follows_path(self) -> bool:
        """Whether the guidance follows the path: false, because a driver may leave the path."""
        return False

    @property
    def outside(self) -> str:
        """Name of the command that provides the inputs, or an empty string for recorded inputs."""
        return "play" if self.inputs.file is None else ""

    def check(self) -> None:
        """Read the recorded inputs. Raise ValueError if the inputs are invalid or refer to a missing guidance law."""
        for law in self.members:
            law.check()
        if (file := self.inputs.file) is not None:
            try:
                highest = max((given.law for given in read_inputs(file).given), default=0)
            except ValueError as error:
                raise ValueError(f"inputs.file: {error}") from None
            if highest > len(self.laws):
                raise ValueError(
                    f"laws: the inputs use law {highest}, but only {len(self.laws)} are listed; add the missing laws"
                )

    def using(self, controller: YawController) -> "Played":
        """Return a copy of this guidance with the yaw controller `controller` in all laws."""
        found = self.model_copy()
        found._members = tuple(law.using(controller) for law in self.members)
        return found

    def init(self) -> PlayState:
        """Return the initial state: control by the driver at standstill."""
        return PlayState()

    def update(self, state: PlayState, situation: Situation, dt: float) -> tuple[PlayState, Command]:
        """Return the new state and the command of the driver or of the active guidance law.

        At zero speed the pedal is in neutral, because the speed loop would overshoot and move the tractor back.
        """
        given = state.given
        if self.inputs.file is not None:
            given = read_inputs(self.inputs.file).at(round(situation.t / TICK_S))
        if given.law:
            return self._follow_law(state._replace(given=given), situation, dt)
        limit = situation.machine.steer_limit
        steer = clip(given.steer, -limit, limit)
        return PlayState(given), Command(steer, given.speed, pedal=None if given.speed else 0.0)

    def _follow_law(self, state: PlayState, situation: Situation, dt: float) -> tuple[PlayState, Command]:
        """Return the new state and the command of the active guidance law, at the law's own time on the path."""
        given, law, route = state.given, self.members[state.given.law - 1], situation.route
        if given.law != state.law:
            e = situation.estimate
            state = PlayState(given, given.law, law.init(), nearest_time(route, e.x, e.y, self.search_s))
        reference = route.at(state.time)
        inner, command = law.update(state.inner, situation._replace(t=state.time, reference=reference), dt)
        rate = 1.0
        if not isnan(given.speed):
            along = abs(to_heading(reference.yaw, reference.vx, reference.vy)[0])
            rate = abs(given.speed) / along if along > LEAST_SPEED_M_S else 1.0
            speed = abs(given.speed) if command.speed >= 0 else -abs(given.speed)
            command = command._replace(speed=speed, pedal=None if speed else 0.0)
        return state._replace(inner=inner, time=state.time + rate * dt), command

    def feedback(self, state: PlayState, command: Command) -> float:
        """Return the feedback part of the steering angle [rad]. For the driver, this is the complete angle."""
        return self.members[state.law - 1].feedback(state.inner, command) if state.law else command.steer

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the driver inputs."""
        return (
            Column("play_law", "-", "number of the active guidance law, from 1; 0 for the driver"),
            Column("play_steer", "rad", "steering angle of the driver, left positive"),
            Column("play_speed", "m/s", "speed set by the driver or for the law; null for the speed of the path"),
        )

    def report(self, state: PlayState) -> Sequence[float]:
        """Return the driver input in the order of `columns`."""
        return float(state.given.law), state.given.steer, state.given.speed


def law_of(table: dict[str, Any], key: str) -> GuidanceLaw:
    """Return the guidance law defined by a table. Raise a ValueError that names `key` if the table is invalid."""
    from agrobot_mj.scenario.reference import families  # the schema contains this law

    kinds = families()["guidance"]
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        raise ValueError(f"{key}.kind: unknown kind {kind!r}{suggestion(str(kind), tuple(kinds))}")
    try:
        law = kinds[kind].model_validate(table)
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"{'.'.join((key, *map(str, first['loc'])))}: {first['msg']}") from None
    if not isinstance(law, GuidanceLaw) or law.outside or isinstance(law, Played):
        raise ValueError(f"{key}.kind: {kind!r} cannot be selected during play; use another kind")
    return law


def nearest_time(route: Route, x: float, y: float, last: float) -> float:
    """Return the time, at most `last` [s], at which the path reference is nearest to the position (x, y) [m]."""
    best = _nearest(route, x, y, 0.0, last, COARSE_S)
    return _nearest(route, x, y, max(best - COARSE_S, 0.0), min(best + COARSE_S, last), FINE_S)


def _nearest(route: Route, x: float, y: float, first: float, last: float, step: float) -> float:
    found, least = first, inf
    for k in range(int((last - first) / step) + 1):
        t = first + k * step
        r = route.at(t)
        if (distance := hypot(r.x - x, r.y - y)) < least:
            found, least = t, distance
    return found
