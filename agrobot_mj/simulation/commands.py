"""Conversion of the arguments of `Simulation.step` to a `Command`."""

from math import atan, isfinite

from agrobot_mj.core.contracts import check_argument
from agrobot_mj.core.errors import CommandError
from agrobot_mj.core.geometry import to_heading
from agrobot_mj.core.kernels import fetched
from agrobot_mj.core.signals import Command
from agrobot_mj.simulation.checks import ABSURD_STEER, limit_steering
from agrobot_mj.simulation.loop import Loop

LEAST_SPEED = 0.1  # Minimum absolute speed in the conversion of a yaw rate to a curvature [m/s]


def command_of(loop: Loop, given: dict[str, float], speed: float | None) -> Command:
    """Return the command for at most one steering argument, `given` by name, and a speed [m/s].

    Without a steering argument the guidance law steers. If `speed` is None, the reference gives the speed. Raises
    `CommandError` or TypeError for invalid arguments.
    """
    numbers = given if speed is None else {**given, "speed": speed}
    for name, value in numbers.items():
        check_argument(name, value, hasattr(value, "__float__"), "a number")  # text has no __float__
        if not isfinite(value):
            raise CommandError(f"{name}: must be a finite number, got {value}")
    if len(given) > 1:
        raise CommandError(f"{' and '.join(given)}: specify only one of them")
    if not given:
        return loop.decide(*loop.now())._replace(speed=float(numbers["speed"]))
    situation, ((kind, value),) = loop.now()[1], given.items()
    r = situation.reference
    along = to_heading(r.yaw, r.vx, r.vy)[0] if speed is None else float(speed)
    if kind == "steer_voltage":
        return Command(situation.steer, along, value)
    if kind == "yaw_rate":
        u = fetched(situation.estimate).speed
        value /= u if abs(u) > LEAST_SPEED else (LEAST_SPEED if u >= 0 else -LEAST_SPEED)
    machine = situation.machine
    angle = value if kind == "steer" else atan(machine.wheelbase_m * value)
    if abs(angle) > ABSURD_STEER:
        raise CommandError(f"{kind}: must be between -pi/2 and pi/2 rad, got {value}")
    return limit_steering(Command(angle, along), machine.steer_limit)
