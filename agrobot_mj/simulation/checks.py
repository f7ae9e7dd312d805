"""Checks of the messages between stages. A non-finite number is an error of the stage that returned the number.

A `Stage` calls one stage and checks its result. If the sum of all numbers of a message is finite, all numbers are
finite; otherwise they are checked individually. Measurements that a real computer would reject, such as a fix that is
not a number, count as missing (see `Reception`).
"""

from array import array
from collections.abc import Callable, Collection, Sequence
from math import degrees, inf, isfinite, nan, radians
from operator import itemgetter
from typing import Any, Generic, NamedTuple, TypeVar, cast, get_args, get_origin

import numpy as np

from agrobot_mj.core.contracts import check_type, check_update, one_line
from agrobot_mj.core.errors import NotFiniteError, ScenarioError
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, jit, shared, stage
from agrobot_mj.core.signals import (
    NOMINAL,
    Array,
    Column,
    Command,
    Conditions,
    Estimate,
    Fix,
    Matrix,
    Measurement,
    Quality,
    Truth,
    Vector,
)
from agrobot_mj.scenario.plugins import place_in_plugin
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.sensors import SensorState, Suite

ABSURD_STEER = radians(90.0)
"""Steering angle above which a command is implausible [rad]: wheels perpendicular to the tractor."""
ARITHMETIC = (ArithmeticError, ValueError, np.linalg.LinAlgError)
"""Types of the exceptions that arithmetic with NaN or infinity may raise."""
_ARITHMETIC = ("math domain error", "infs or NaNs", "cannot convert float")
"""Parts of ValueError messages that indicate NaN or infinity as an operand."""

FARTHEST_M, FASTEST_M_S = 1e7, 1e3
"""Maximum plausible distance from the origin [m] and speed [m/s] of a fix: a quarter of the equator, and Mach 3."""
OPTIONAL = ("gyro", "roll", "pitch", "wheel_speed")  # Measurements that are NaN if the tractor has no sensor for them

Message = TypeVar("Message", bound=tuple[Any, ...])


class Numbers:
    """Check of the types and the finiteness of the numbers of a message. Fields with the default NaN may be NaN."""

    def __init__(self, message: Any, but: Collection[str] = (), name: str = "") -> None:
        """Collect the numeric fields of the class `message`, except the fields `but`. Optional fields may be None."""
        hints, defaults, self.name = message.__annotations__, message._field_defaults, name or message.__name__.lower()
        self._kind, self._places = message, {field: k for k, field in enumerate(message._fields)}
        shapes = {n: _shape(hints[n], defaults.get(n, 0.0)) for n in message._fields if n not in but}
        kinds = "one", "none", "few", "many", "flag", "unknown"
        at = {s: [self._places[n] for n in shapes if shapes[n] == s] for s in kinds}
        self._ones, self._nones, self._many = itemgetter(*at["one"]), at["none"], at["many"]
        self._few = [(k, len(get_args(hints[message._fields[k]]))) for k in at["few"]]
        self._flags, self._unknowns, self._shapes = at["flag"], at["unknown"], shapes
        self._parts = [(self._places[n], self._part(hints[n], n)) for n in shapes if shapes[n] == "message"]
        self._lists = [
            (self._places[n], self._part(get_args(hints[n])[0], n)) for n in shapes if shapes[n] == "messages"
        ]

    def _part(self, message: Any, field: str) -> "Numbers":
        return Numbers(message, name=f"{self.name}.{field}")

    def check(self, message: Any, maker: str) -> None:
        """Raise `NotFiniteError` for a number that is not finite, and `ScenarioError` for a value of another type.

        Error texts name the stage `maker`, which returned the checked message.
        """
        if not isinstance(message, self._kind):
            kind = self._kind.__name__
            raise ScenarioError(f"{maker} returned {one_line(message)} as {self.name}; return an object of {kind}")
        for k, part in self._parts:
            part.check(message[k], maker)
        for k, part in self._lists:
            for each in message[k]:
                part.check(each, maker)
        try:
            total: float = sum(self._ones(message))  # finite if all numbers are finite
            for k, count in self._few:
                total += _sum(message[k], count)
            for k in self._many:
                total += sum(message[k].ravel().tolist())
            for k in self._nones:
                total += message[k] or 0.0
            for k in self._flags:
                total += bool(message[k])
            for k in self._unknowns:
                isfinite(message[k])  # raises an error unless the field is a number
            finite = isfinite(total)
        except WRONG_TYPE:
            text = f"{one_line(message)}{self._wrong(message)}"
            raise ScenarioError(f"{maker} returned a non-numeric {self.name}: {text}") from None
        if finite:
            return
        for field, shape in self._shapes.items():
            value = getattr(message, field)
            if shape in ("one", "few", "many", "none") and value is not None and not np.isfinite(value).all():
                shown = np.ravel(value)
                raise NotFiniteError(f"{self.name}.{field} is {shown[~np.isfinite(shown)][0]}, returned by {maker}")
        raise NotFiniteError(f"{self.name}, returned by {maker}, overflows")

    def _wrong(self, message: Any) -> str:
        """Return the description of the first field with a wrong type, such as `; estimate.nis is None`."""
        counts = dict(self._few)
        for field, shape in self._shapes.items():
            value, violated = getattr(message, field), "is"
            try:
                if shape == "few":
                    violated = f"must be a tuple of {counts[self._places[field]]} numbers, got"
                    isfinite(_sum(value, counts[self._places[field]]))
                elif shape == "many":
                    isfinite(sum(value.ravel().tolist()))
                elif shape == "flag":
                    bool(value)
                elif shape in ("one", "unknown") or (shape == "none" and value is not None):
                    isfinite(value)
            except WRONG_TYPE:
                return f"; {self.name}.{field} {violated} {one_line(value)}"
        return ""


WRONG_TYPE = AttributeError, TypeError, ValueError, OverflowError
"""Types of the exceptions that arithmetic with a wrong type, or with an integer above the range of floats, raises."""


def _sum(numbers: Any, count: int) -> Any:
    """Return the sum of a tuple. Raise TypeError unless `numbers` is a tuple of `count` elements."""
    if not isinstance(numbers, tuple) or len(numbers) != count:
        raise TypeError
    return sum(numbers)


def _shape(hint: Any, default: Any) -> str:
    """Return the type of a field: "one" number, "few" (tuple), "many" (array), "none" (number or None), "unknown"
    (number or NaN), "flag", "message" or "messages" (tuple of messages).

    The result is "" for a field that is not checked.
    """
    few = get_origin(hint) is tuple and set(get_args(hint)) == {float}
    if few or hint in (int, float):
        if np.isnan(default).any():
            return "" if few else "unknown"
        return "few" if few else "one"
    if hint == float | None or hint is bool:
        return "flag" if hint is bool else "none"
    if get_origin(hint) is tuple and hasattr(get_args(hint)[0], "_fields"):
        return "messages"
    return "many" if hint in (Array, Vector, Matrix) else "message" if hasattr(hint, "_fields") else ""


STATE, SAMPLED_STATE = Numbers(Truth, but=("steer_samples", "pedal_samples", "knuckle_samples")), Numbers(Truth)
"""Checks that the true state is finite: the first omits the samples of each physics step, the second includes them and
runs only after invalid measurements."""
CONDITIONS = Numbers(Conditions)


class Stage(Generic[Message]):
    """Wrapper that calls one stage, such as the estimator, and checks the result.

    `update` and `ask` raise `NotFiniteError` if the arithmetic fails or a number is not finite, and `ScenarioError` for
    a message of a wrong type.
    """

    def __init__(
        self,
        name: str,
        kind: str,
        part: Any,
        message: type[Message],
        passed: Callable[[Message], Message] = lambda message: message,
        method: str = "update",
    ) -> None:
        """Wrap the method `method` of the stage `part`. Error messages contain `name` and `kind`. `passed` checks and
        converts each result."""
        self.names, self.part, self.message, self.passed, self.method = (name, kind), part, message, passed, method
        self.maker, self.numbers = f"{name} ({kind})", Numbers(message)
        self.pending: tuple[Any, Message] | BaseException | None = None
        """Result or error of the stage in the current tick, if an episode called the stage but ended before this tick,
        else None."""

    def update(self, *arguments: Any) -> tuple[Any, Message]:
        """Call a simulation stage that has a state, such as the estimator. Return the new state and the checked
        message."""
        if self.pending is not None:
            pending, self.pending = self.pending, None
            if isinstance(pending, BaseException):
                raise pending
            return pending
        found = self._find(arguments)
        if self.method == "update_held":  # by a compiled estimator
            if _is_finite(found[1]):
                return cast(tuple[Any, Message], found)
            found = found[0], fetched(found[1])
        state, message = check_update(found, self.message, *self.names, self.method)
        self.numbers.check(message, self.maker)
        return state, self.passed(message)

    def ask(self, *arguments: Any) -> Message:
        """Call a simulation stage that has no state. Return the checked message."""
        message = check_type(self._find(arguments), self.message, *self.names, self.method)
        self.numbers.check(message, self.maker)
        return self.passed(message)

    def _find(self, arguments: tuple[Any, ...]) -> Any:
        try:
            return getattr(self.part, self.method)(*arguments)
        except ARITHMETIC as error:
            numbers = not isinstance(error, ValueError) or isinstance(error, np.linalg.LinAlgError)
            numbers = numbers or any(part in str(error) for part in _ARITHMETIC)
            if isinstance(error, NotFiniteError) or not numbers:
                raise
            raise NotFiniteError(f"{self.maker} failed: {error}{place_in_plugin(error)}") from error


@jit
def is_finite(estimate: Held[Estimate]) -> bool:
    """Return whether all numbers of an estimate are finite, except fields with the default NaN."""
    e = fetched(estimate)
    total = e.x + e.y + e.yaw + e.speed + e.yaw_rate + e.rear_x + e.rear_y + e.sideslip
    for variance in e.covariance.flat:
        total += variance
    return isfinite(total)


_is_finite = stage(is_finite)


class Reception(NamedTuple):
    """State of the sensors, last valid steering angle and pedal position, and counts of rejected values."""

    sensors: SensorState
    steer: float = 0.0  # Last finite steering angle [rad]
    pedal: float = 0.0  # Last finite pedal position [-]
    rejected: tuple[tuple[str, int], ...] = ()  # Number of rejected values for each field of `Measurement`

    def after(
        self, s: Scenario, suite: Suite, truth: Held[Truth], conditions: Conditions
    ) -> "tuple[Reception, Measurement]":
        """Return the new state and the checked measurement of a tick.

        An invalid fix counts as missing. The last valid value replaces an invalid steering angle or pedal position. NaN
        replaces an infinite value of another sensor. Raises `NotFiniteError` if the invalid number comes from the plant
        or from a fault.
        """
        if not (suite.plain and conditions is NOMINAL):
            STATE.check(fetched(truth), f"the plant ({s.plant.kind})")
        if conditions is not NOMINAL:
            CONDITIONS.check(conditions, f"a fault ({', '.join(fault.kind for fault in s.fault)})")
        return self.check_measurement(s, *suite.measure(self.sensors, truth, conditions), truth)

    def check_measurement(
        self, s: Scenario, sensors: SensorState, measured: Measurement, truth: Held[Truth]
    ) -> "tuple[Reception, Measurement]":
        """Return the new state and the checked measurement, as in `after`, for sensors that have already been read."""
        _, fix, _, steer, pedal, *optional, _ = measured
        sound = fix is None or possible(fix)
        if sound and sensors.sound and isfinite(steer + pedal) and inf not in map(abs, optional):
            return Reception(sensors, steer, pedal, self.rejected), measured
        SAMPLED_STATE.check(fetched(truth), f"the plant ({s.plant.kind})")
        changes: dict[str, Any] = {} if sound else {"fix": None, "quality": Quality.NONE}
        for name in ("steer", "pedal"):
            if not isfinite(getattr(measured, name)):
                changes[name] = getattr(self, name)
        changes |= {name: nan for name, value in zip(OPTIONAL, optional, strict=True) if abs(value) == inf}
        counts = dict(self.rejected)
        counts |= {name: counts.get(name, 0) + 1 for name in changes if name != "quality"}
        measured = measured._replace(**changes)
        return Reception(sensors, measured.steer, measured.pedal, tuple(counts.items())), measured


@shared
def possible(fix: Fix) -> bool:
    """Return whether the position and the velocity of a fix are plausible. NaN is permitted for height and heading."""
    sound = abs(fix.z) != inf and abs(fix.heading) != inf  # NaN means "not reported"
    return sound and abs(fix.x) + abs(fix.y) < FARTHEST_M and abs(fix.vx) + abs(fix.vy) < FASTEST_M_S


def check_report(maker: str, columns: Sequence[Column], report: Any) -> None:
    """Raise `ScenarioError` unless the `report` of a simulation stage contains one number for each of its log
    columns."""
    try:
        numbers = array("d", () if isinstance(report, str) else report)
    except (TypeError, ValueError, OverflowError):
        numbers = None
    if numbers is None or len(numbers) != len(columns):
        count = f"{len(columns)} numbers, one per column"
        raise ScenarioError(f"{maker}: the method report() must return {count}, got {one_line(report)}")


def read_only(estimate: Estimate) -> Estimate:
    """Return the estimate with a C-contiguous covariance that other stages cannot change.

    Raises `ScenarioError` for a covariance of a wrong shape, which compiled stages do not check.
    """
    given = estimate.covariance
    if given.shape != (3, 3):
        raise ScenarioError(f"estimate.covariance must have the shape (3, 3), got {given.shape}")
    covariance = np.ascontiguousarray(given, dtype=float)
    if covariance is given and not given.flags.writeable:
        return estimate
    covariance = covariance.view()
    covariance.flags.writeable = False
    return estimate._replace(covariance=covariance)


def steerable(s: Scenario, command: Command) -> Command:
    """Return the command with its steering angle limited to the stops. Raises `NotFiniteError` above 90 deg."""
    if abs(command.steer) > ABSURD_STEER:
        angle = f"{degrees(command.steer):.4g} deg, more than 90 deg"
        raise NotFiniteError(f"command.steer is {angle}, returned by the guidance law ({s.guidance.kind}); use radians")
    return limit_steering(command, s.tractor.steer_limit)


def limit_steering(command: Command, steer_limit: float) -> Command:
    """Return the command with its steering angle limited to `steer_limit` [rad]."""
    if -steer_limit <= command.steer <= steer_limit:
        return command
    return command._replace(steer=min(max(command.steer, -steer_limit), steer_limit))
