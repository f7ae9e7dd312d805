"""Compiled function that performs a tick of the supervisor while the tractor follows its path."""

from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.control.deviation import Situated
from agrobot_mj.control.evidence import Sensed
from agrobot_mj.control.monitors import Limits, MonitorSignals
from agrobot_mj.control.reckoning import EPOCH_S, HITCH_SIGMA, References, compare_with_fix
from agrobot_mj.control.sums import Sums, Vehicle, add_tick
from agrobot_mj.control.supervisor import Mode, MonitoredCommand, Supervisor, SupervisorState, update_monitors
from agrobot_mj.core.calls import Linked, address_of, caller_of
from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, stage
from agrobot_mj.core.samples import WINDOW_M, nearest_point
from agrobot_mj.core.signals import Fix, Matrix, Vector
from agrobot_mj.machine.implements import TowedImplement
from agrobot_mj.machine.tractor import TractorParameters

NO_REFERENCES = References(np.zeros((0, 7)), np.zeros((0, 7, 7)), np.zeros(0))
_monitored, _summed, _compared = caller_of(update_monitors), caller_of(add_tick), caller_of(compare_with_fix)


class SupervisionLaw(NamedTuple):
    """Parameters of the supervisor, and addresses of the compiled functions that `supervise_tick` calls."""

    limits: Held[Limits]
    reckons: bool  # Whether dead reckoning has started; it never starts without a gyro
    vehicle: Vehicle
    towed: TowedImplement
    aligning_speed: float  # Commanded speed until the heading is known [m/s]
    coasting_after: float  # Maximum time since the newest fix before the tractor coasts [s]
    monitor: int  # Address of `supervisor.update_monitors`
    sum: int  # Address of `sums.add_tick`
    compare: int  # Address of `reckoning.compare_with_fix`


class Supervision(NamedTuple):
    """State of the supervisor in the mode TRACKING; `SupervisorState` and `Reckoning` describe the fields."""

    watched: Held[MonitorSignals]
    shown: tuple[float, float, float]
    over_s: Vector
    steer: float
    sums: Held[Sums]
    checked: Held[Sums]
    checked_t: float
    references: Held[References]
    distance: float
    sigma: float


def supervisor_form(
    law: Held[Any], state: Held[Any], samples: Matrix, seen: Situated, m: Sensed, fix: Fix, quality: int, steer: float,
    speed: float, pedal: float, sampled: float, dt: float,
) -> tuple[Held[Any], tuple[float, float, float], bool]:  # fmt: skip
    """Define the signature of `supervise_tick` for compiled calls. The function itself is never called."""
    raise NotImplementedError


@stage
def supervise_tick(
    law: Held[SupervisionLaw], state: Held[Supervision], samples: Matrix, seen: Situated, m: Sensed, fix: Fix,
    quality: int, steer: float, speed: float, pedal: float, sampled: float, dt: float,
) -> tuple[Held[Supervision], tuple[float, float, float], bool]:  # fmt: skip
    """Return the new state, `SupervisorState.shown`, and whether the mode remains TRACKING, after a tick with a fix.

    `steer` [rad] and `speed` [m/s] are the command of the guidance law; `pedal` is the last pedal reference [-].
    The path is sampled up to the arc length `sampled` [m].
    """
    p, s, e = fetched(law), fetched(state), fetched(seen.estimate)
    nearest = nearest_point(samples, e.x, e.y, s.shown[1], seen.low, seen.high)
    done, sums = True, s.sums
    if p.reckons:
        done, sums = _summed(p.sum, (s.sums, m, fix, p.vehicle, p.towed, dt))
    if not (done and e.aligned and max(s.shown[1], seen.low) + WINDOW_M <= sampled):
        return state, s.shown, False
    checked, checked_t, references, distance, sigma = s.checked, s.checked_t, s.references, s.distance, s.sigma
    if p.reckons and m.t - checked_t >= EPOCH_S - 0.5 * dt:
        swing = HITCH_SIGMA * p.towed.antenna
        done, (references, distance, sigma) = _compared(p.compare, (references, checked, sums, fix, quality, m, swing))
        if not done:
            return state, s.shown, False
        checked, checked_t = sums, fetched(sums).t
    wanted = MonitoredCommand(s.steer, abs(speed), pedal, p.aligning_speed)
    reckoned = distance, sigma
    done, (signals, shown, over_s, first, _, cut) = _monitored(
        p.monitor,
        (p.limits, s.watched, s.over_s, nearest, seen.estimate, m, fix, quality, seen.steer, wanted, reckoned, dt),
    )
    tracks = done and first < 0 and not cut and shown[0] <= p.coasting_after
    after = Supervision(signals, shown, over_s, steer, sums, checked, checked_t, references, distance, sigma)
    return held(after), shown, tracks


def tick_link(
    supervisor: Supervisor, state: SupervisorState, machine: TractorParameters, towed: TowedImplement, gyro: bool
) -> Linked | None:
    """Return the compiled tick function, its parameters and its state, or None if the next tick needs Python.

    Compiled ticks require the mode TRACKING and, if the tractor has a `gyro`, dead reckoning with a known heading.
    """
    r = state.reckoning
    if state.mode is not Mode.TRACKING or state.released or not (state.watched and state.limits):
        return None
    if gyro if r.checked is None else r.references is None:
        return None
    law = SupervisionLaw(
        limits=state.limits,
        reckons=r.checked is not None,
        vehicle=Vehicle(machine.wheelbase_m, machine.antenna_height_m, supervisor.gyro_axes == "body"),
        towed=towed,
        aligning_speed=supervisor.aligning_speed_m_s,
        coasting_after=supervisor.coasting_after_s,
        monitor=address_of(update_monitors, update_monitors),
        sum=address_of(add_tick, add_tick),
        compare=address_of(compare_with_fix, compare_with_fix),
    )
    sums = r.sums[-1] if r.sums else held(Sums())
    now = Supervision(
        watched=state.watched,
        shown=state.shown,
        over_s=state.over_s,
        steer=state.steer,
        sums=sums,
        checked=r.checked or sums,
        checked_t=r.checked_t,
        references=r.references or held(NO_REFERENCES),
        distance=r.distance,
        sigma=r.sigma,
    )
    return Linked(supervise_tick, held(law), held(now))


def tracking(state: SupervisorState, found: Held[Supervision], pedal: float) -> SupervisorState:
    """Return the state of the supervisor after ticks in compiled code, which ended with the state `found`.

    `pedal` is the last measured pedal position [-].
    """
    now, reckoning = fetched(found), state.reckoning
    if reckoning.checked is not None:
        names = "checked", "checked_t", "references", "distance", "sigma"
        reckoning = reckoning._replace(sums=(now.sums,), **{name: getattr(now, name) for name in names})
    return state._replace(
        watched=now.watched, shown=now.shown, over_s=now.over_s, steer=now.steer, pedal=pedal, reckoning=reckoning
    )
