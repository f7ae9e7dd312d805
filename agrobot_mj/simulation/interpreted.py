"""Guidance laws and estimators in Python within episodes: each compiled tick calls the Python stage once."""

import ctypes
from array import array
from collections.abc import Callable, Sequence
from math import inf, nan
from time import perf_counter
from typing import Any, NamedTuple, cast
from weakref import WeakMethod

import numpy as np

from agrobot_mj.control.base import Situation
from agrobot_mj.control.deviation import Followed, Situated
from agrobot_mj.core.calls import Linked, call_back
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import COMPILES, copy_into, fetched, held, stage
from agrobot_mj.core.reporting import Reporting
from agrobot_mj.core.signals import TICK_S, Command, Estimate, Fix, Matrix, Measurement, Reference, Vector
from agrobot_mj.estimation.base import Readings
from agrobot_mj.faults.base import Scripted
from agrobot_mj.sensors.implement_gnss import ImplementFix
from agrobot_mj.sensors.imu import Attitude
from agrobot_mj.sensors.sensing import SensorReadings
from agrobot_mj.simulation.checks import Stage
from agrobot_mj.simulation.loop import Loop

FIX, COMMAND, ESTIMATE = len(Fix._fields), 2, 23  # Number of numbers of a fix, a command and an estimate
LONGEST_S = 0.5  # Wall time after which an episode ends [s], so that system signals take effect between its ticks
UNKNOWN = Followed(nan, nan, 0.0, nan, nan, nan, 0.0, nan)


class Exchange(NamedTuple):
    """Address of the Python function of a stage, and the numbers that compiled code exchanges with this function."""

    function: int
    inputs: Vector  # Numbers that the compiled function of the stage writes
    outputs: Vector  # Result and column values; the first number is NaN if the tick has failed


@stage
def interpreted_law(
    law: Held[Exchange], state: Held[Exchange], last: tuple[float, float], samples: Matrix, seen: Situated,
    r: Reference, dt: float,
) -> tuple[Held[Exchange], Followed, float, Vector]:  # fmt: skip
    """Call a guidance law in Python from compiled code; `deviation.law_form` describes the results."""
    exchange, e, k = fetched(law), fetched(seen.estimate), 0
    given, found = exchange.inputs, exchange.outputs
    for value in (
        seen.t, seen.steer, seen.roll, seen.implement[0], seen.implement[1],
        e.x, e.y, e.yaw, e.speed, e.yaw_rate, e.rear_x, e.rear_y,
        e.nis, e.steer_bias, e.sideslip, e.fix_age, e.position_sigma, e.nis_mean, 1.0 if e.aligned else 0.0,
        r.x, r.y, r.vx, r.vy, r.yaw, r.curvature, r.curvature_rate,
    ):  # fmt: skip
        given[k] = value
        k += 1
    copy_into(given[k:], e.covariance)
    call_back(exchange.function)
    return state, Followed(nan, found[0], 0.0, nan, nan, nan, 0.0, found[1]), -inf, found[COMMAND:]


@stage
def interpreted_estimator(
    settings: Held[Exchange], law: Held[Exchange], state: Held[Exchange], m: Readings, fix: Fix, quality: int, dt: float
) -> tuple[Held[Exchange], Held[Estimate], Vector]:
    """Call an estimator in Python from compiled code; `estimation.base.estimator_form` describes the results.

    The estimator also reads the measurements in `InterpretedEstimator.measured`.
    """
    exchange = fetched(law)
    for k, value in enumerate(fix):
        exchange.inputs[k] = value
    call_back(exchange.function)
    v, covariance = exchange.outputs, np.empty((3, 3))
    copy_into(covariance, v[14:ESTIMATE])
    estimate = Estimate(
        v[0], v[1], v[2], v[3], v[4], v[5], v[6], covariance, v[7], v[8], v[9], v[10] != 0.0, v[11], v[12], v[13]
    )  # fmt: skip
    return state, held(estimate), v[ESTIMATE:]


def interpreted_stages(loop: Loop) -> tuple[str, ...]:
    """Return the scenario tables of the stages that run in Python.

    A run has no episodes if the result contains a stage other than `guidance` and `estimator`.
    """
    s, suite = loop.scenario, loop.suite
    in_python = {
        "sensors": not (suite.plain and suite.compiled_only),
        "fault": any(type(fault).active is not Scripted.active for fault in s.fault),
        "estimator": s.estimator.interpreted,
        "guidance": loop.guidance.interpreted,
        "steering": loop.loops.part.other is not None,
    }
    return tuple(name for name, found in in_python.items() if found or not COMPILES)


class Interpreted:
    """Stage in Python, with a C function through which compiled code calls the stage."""

    def __init__(
        self,
        stage: Stage[Any],
        part: Reporting,
        sizes: tuple[int, int],
        read: Callable[[list[float]], Any],
        numbers: Callable[[Any], Sequence[float]],
    ) -> None:
        """Prepare the C function that calls `stage`; `part` is the guidance law or the estimator of this stage.

        `sizes` contains the number of inputs, and the number of outputs that precede the log columns. `read` converts
        the inputs to the argument of the stage, and `numbers` converts the result to numbers; an error of `numbers`
        ends the episode.
        """
        self.stage, self.part, self.read, self.numbers = stage, part, read, numbers
        call = WeakMethod(self._call)  # a strong reference would delay the deletion of the simulation
        self.function = ctypes.CFUNCTYPE(None)(lambda: cast(Any, call())())
        address = ctypes.cast(self.function, ctypes.c_void_p).value or 0
        self.exchange = Exchange(address, np.zeros(sizes[0]), np.zeros(sizes[1] + len(part.columns)))
        self.held, self.filled = held(self.exchange), sizes[1]

    def begin(self, state: Any) -> Held[Exchange]:
        """Set the state of the stage at the start of an episode. Return the parameters of the compiled function."""
        self.before: Any = state
        self.found: tuple[Any, Any] = state, None
        self.error: BaseException | None = None
        self.count = 0
        return self.held

    def _call(self) -> None:
        """Call the stage. An error is stored, because compiled code cannot raise it.

        NaN as the first output ends the episode after an error, after `LONGEST_S`, and for a report or a result that is
        not numeric. A single tick then uses the stored result, and raises the errors of the report.
        """
        outputs, self.before = self.exchange.outputs, self.found[0]
        self.count += 1
        if self.count == 1:
            self.due = perf_counter() + LONGEST_S
        outputs[0] = nan
        try:
            self.found = self.stage.update(self.before, self.read(self.exchange.inputs.tolist()), TICK_S)
        except BaseException as error:
            self.error = error
            return
        try:
            report, numbers = array("d", self.part.report(self.found[0])), self.numbers(self.found[1])
            if len(report) == len(outputs) - self.filled and perf_counter() < self.due:
                outputs[self.filled :] = report
                outputs[: self.filled] = numbers
        except KeyboardInterrupt as error:
            self.error = error
        except BaseException:
            pass  # a single tick raises the error again

    def end(self, count: int) -> Any:
        """Return the state of the stage after an episode that used the results of the first `count` calls.

        The result of a further call is stored for the single tick that follows.
        """
        if self.count == count:
            return self.found[0]
        self.stage.pending = self.found if self.error is None else self.error
        return self.before


class InterpretedLaw(Interpreted):
    """Guidance law in Python that compiled code calls."""

    def __init__(self, loop: Loop) -> None:
        """Prepare the guidance law of `loop` for calls from compiled code."""
        super().__init__(loop.law, loop.guidance, (35, COMMAND), self._situation, self._numbers)
        self.route, self.machine, self.towed = loop.route, loop.scenario.tractor, loop.towed

    def compiled_tick(self, state: Any) -> Linked:
        """Return the function and data with which compiled code calls the law, starting with the law's state
        `state`."""
        law = self.begin(state)
        return Linked(interpreted_law, law, law, UNKNOWN)

    def _situation(self, v: Any) -> Situation:
        covariance = np.array(v[26:]).reshape(3, 3)
        covariance.flags.writeable = False
        estimate = Estimate._make((*v[5:12], covariance, *v[12:15], v[18] != 0.0, *v[15:18]))
        seen = v[1], v[2], (v[3], v[4])
        return Situation(v[0], estimate, Reference(*v[19:26]), self.route, self.machine, *seen, self.towed)

    @staticmethod
    def _numbers(command: Command) -> tuple[float, float]:
        if command.steer_voltage is not None or command.pedal is not None or command.released:
            raise ValueError("only single ticks perform commands with voltages")
        return command.steer, command.speed


class InterpretedEstimator(Interpreted):
    """Estimator in Python that compiled code calls."""

    def __init__(self, loop: Loop) -> None:
        """Prepare the estimator of `loop` for calls from compiled code."""
        part, sizes = loop.scenario.estimator, (FIX + 19, ESTIMATE)
        super().__init__(loop.estimator, part, sizes, self._measurement, self._numbers)
        self.suite = loop.suite

    @property
    def measured(self) -> Vector:
        """Array for the measurement of a tick, in the order in which `_measurement` reads it."""
        return self.exchange.inputs[FIX:]

    def compiled_tick(self, state: Any) -> Linked:
        """Return the function and data with which compiled code calls the estimator, starting with its state
        `state`."""
        law = self.begin(state)
        return Linked(interpreted_estimator, law, law, law)

    def _measurement(self, v: Any) -> Measurement:
        fix, gnss, (heading, steer, pedal, gyro) = Fix(*v[:7]), tuple(v[7:13]), v[13:17]
        angles, (wheels, radar), implement = Attitude(*v[17:22]), v[22:24], ImplementFix(*v[24:])
        found = SensorReadings(gnss, heading, steer, pedal, gyro, angles, wheels, radar, implement)
        return self.suite.measurement(found)._replace(fix=fix)

    @staticmethod
    def _numbers(given: Held[Estimate]) -> list[float]:
        e = fetched(given)
        return [*e[:7], *e[8:], *e.covariance.ravel().tolist()]
