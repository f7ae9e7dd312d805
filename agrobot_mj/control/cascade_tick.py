"""Compiled function that performs a tick of a cascade of guidance law and yaw controller.

For the laws `kinematic` and `feedforward`, the function gives the same results as `Cascade.update`. The function calls
the compiled yaw controller by its memory address.
"""

from math import atan, inf, isfinite, nan
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.control.base import YawCommand, controller_form, steer_limit_at
from agrobot_mj.control.cascade import Cascade, CascadeState
from agrobot_mj.control.deviation import Followed, Situated
from agrobot_mj.control.feedforward import Feedforward
from agrobot_mj.control.kinematic import (
    CascadeLaw,
    Kinematic,
    approach,
    feasible,
    gain_scale,
    inverse_kinematics,
    onward,
    scaled_saturation,
)
from agrobot_mj.control.pid import clip
from agrobot_mj.core.calls import Linked, address_of, caller_of
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, stage
from agrobot_mj.core.signals import Matrix, Reference, Vector
from agrobot_mj.machine.tractor import TractorParameters

_controller = caller_of(controller_form)


class CascadeNumbers(NamedTuple):
    """Parameters of a `CascadeLaw`, its tractor and its yaw controller, as numbers for `cascade_tick`."""

    saturation: float
    gain: float
    above: float  # `scheduled_above_m_s`, or NaN for constant gains
    scales: bool  # Whether the saturation increases with the speed, as in `Kinematic`
    ends_turns: bool
    feeds: bool  # Whether the law has feed-forward
    lateral_acceleration: float
    wheelbase: float  # Wheelbase [m]
    l_r: float  # Distance from the CG to the rear axle [m]
    steer_limit: float  # Maximum steering angle [rad]
    controller: int  # Address of the function of the yaw controller
    controller_law: Held[Any]


class CascadeMemory(NamedTuple):
    """State of the cascade between two ticks; `CascadeState` describes the fields."""

    controller: Held[Any]
    yaw_rate_ref: float
    e_yaw_rate: float
    command: YawCommand
    feedforward: float
    shown: Vector  # Values of the columns of the yaw controller


@stage
def cascade_tick(
    law: Held[CascadeNumbers], state: Held[CascadeMemory], last: tuple[float, float], samples: Matrix, seen: Situated,
    r: Reference, dt: float,
) -> tuple[Held[CascadeMemory], Followed, float, Vector]:  # fmt: skip
    """Return the new state, the command, -inf (the cascade needs no sampled path), and the values of the log columns.

    The steering command is NaN if the tick has failed.
    """
    p, s, e = fetched(law), fetched(state), fetched(seen.estimate)
    vx, vy = approach(scaled_saturation(p.saturation, p.above, r) if p.scales else p.saturation, p.gain, e, r)
    if p.ends_turns:
        vx, vy = onward(vx, vy, r)
    speed, yaw_rate = inverse_kinematics(vx, vy, e.yaw, p.l_r)
    if p.ends_turns:
        yaw_rate = feasible(yaw_rate, r, e.speed, (p.steer_limit, p.l_r, p.wheelbase))
    limit, error = steer_limit_at(e.speed, p.lateral_acceleration, p.wheelbase, p.steer_limit), yaw_rate - e.yaw_rate
    ahead = atan(p.wheelbase * seen.preview) if p.feeds else 0.0
    scaled = gain_scale(p.wheelbase, p.above, e.speed) * error
    done, (controller, command, shown) = _controller(
        p.controller, (p.controller_law, s.controller, scaled, ahead, seen.steer, dt, limit)
    )
    sound = done and isfinite(speed + yaw_rate) and isfinite(command.steer + command.tau_c + command.tau_n)
    steer = clip(command.steer + ahead, -limit, limit) if sound else nan
    reported = np.empty(5 + p.feeds + shown.size)
    for k, value in enumerate((yaw_rate, error, command.tau_c, command.tau_n, command.q)):
        reported[k] = value
    if p.feeds:
        reported[5] = ahead
    for k in range(shown.size):
        reported[5 + p.feeds + k] = shown[k]
    after = CascadeMemory(controller, yaw_rate, error, command, ahead, shown)
    return held(after), Followed(nan, steer, 0.0, nan, nan, nan, 0.0, speed), -inf, reported


def tick_link(law: Cascade, state: CascadeState, machine: TractorParameters) -> Linked | None:
    """Return function and data for ticks in compiled code, or None if the next tick of the controller needs Python."""
    outer: CascadeLaw = law.law
    if (controller := law.controller.compiled_tick(state.controller)) is None:
        return None
    above = outer.scheduled_above_m_s
    numbers = CascadeNumbers(
        saturation=outer.saturation_m_s,
        gain=outer.gain_per_m,
        above=nan if above is None else above,
        scales=isinstance(outer, Kinematic),
        ends_turns=outer.ends_turns,
        feeds=isinstance(outer, Feedforward),
        lateral_acceleration=outer.lateral_acceleration_m_s2,
        wheelbase=machine.wheelbase_m,
        l_r=machine.cg_to_rear_axle,
        steer_limit=machine.steer_limit,
        controller=address_of(controller.function, controller_form),
        controller_law=controller.law,
    )
    memory = CascadeMemory(
        *(controller.state, state.yaw_rate_ref, state.e_yaw_rate, state.command, state.feedforward),
        np.array(law.controller.report(state.controller), dtype=float),
    )
    unknown = Followed(nan, nan, 0.0, nan, nan, nan, 0.0, nan)
    preview_s = outer.preview_s if isinstance(outer, Feedforward) else nan
    return Linked(cascade_tick, held(numbers), held(memory), unknown, preview_s)


def state_after_ticks(law: Cascade, state: CascadeState, found: Held[CascadeMemory]) -> CascadeState:
    """Return the state of the cascade after ticks in compiled code; `found` is their last state."""
    now = fetched(found)
    controller = law.controller.state_after_ticks(state.controller, now.controller, now.shown)
    return CascadeState(controller, now.yaw_rate_ref, now.e_yaw_rate, now.command, now.feedforward, state.speed)
