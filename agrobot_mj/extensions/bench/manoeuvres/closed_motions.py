"""Closed motions

The sliding, rolling and load of a wheel follow random periodic signals. The wheel is at rest, rolls back and forth, or
rolls forwards, with loads from almost zero to twice the static load of either axle. In the periodic steady state, the
ground may only dissipate energy. Over one period, the ground must not do positive work on the wheel, for any phases of
the motions. The work of the load is excluded, because a spring returns it over a period. The check also covers an
implement that works the soil at varying depth.
"""

from collections.abc import Iterator
from math import pi
from typing import NamedTuple

import numpy as np

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial, force_tyres
from agrobot_mj.machine.implements.draught import Tool
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.mujoco.tools import MEMORIES, soil_on_tool
from agrobot_mj.terrain import Flat, Ground
from agrobot_mj.tyres import Ruts, TyreBase
from agrobot_mj.tyres.laws import tyre_set, wheel_step
from agrobot_mj.tyres.patch import TyreSet, WheelMotion

TRACTOR = TractorParameters()
DT_S, PERIODS = 0.001, 3  # Time step [s], and number of simulated periods. Only the last period is evaluated.
HARMONICS, SEED = 2, 20
MOTIONS, BRIEFLY = 1000, 60  # Number of motions per tyre in the full suite and in the quick suite
ROUNDING = 1e-6  # Maximum energy gain due to rounding errors, divided by the energy exchanged in a period [-]


class Cycle(NamedTuple):
    """Periodic motion of one wheel that returns to its start.

    Each signal has shape (5,): its mean and `HARMONICS` pairs (amplitude, phase).
    """

    wheel: int  # Index of the wheel: 0 for front left, 2 for rear left
    period: float  # Period [s]
    ahead: Array  # Forward velocity of the hub [m/s]
    aside: Array  # Velocity of the hub to the left [m/s]
    skid: Array  # Circumferential velocity of the rim minus forward velocity of the hub [m/s]
    sunk: Array  # Vertical deflection of the tyre [m]


def cycle(rng: np.random.Generator) -> Cycle:
    """Return a random periodic motion of a wheel."""
    wheel, period = int(rng.choice([0, 2])), float(10 ** rng.uniform(-0.5, 0.5))
    static = TRACTOR.wheels[wheel // 2].deflection

    def wave(mean: float, size: float) -> Array:
        share = rng.uniform(0.0, 1.0, HARMONICS)
        phase = rng.uniform(0.0, 2 * pi, HARMONICS)
        return np.array([mean, *np.stack([size * share / max(share.sum(), 1.0), phase], axis=1).ravel()])

    # patch displacements from 0.1 mm to the length of the patch, so that the tyre sticks or slides
    speed, swing = (10 ** rng.uniform(-4.0, -1.0) * 2 * pi / period for _ in range(2))
    rolling = rng.choice([0.0, 0.0, 1.0]) * 10 ** rng.uniform(-2.0, 0.5)
    return Cycle(
        wheel=wheel,
        period=period,
        ahead=wave(rng.choice([-1.0, 0.0, 1.0]) * rolling, rolling * rng.uniform(0.0, 1.5)),
        aside=wave(rng.choice([0.0, 0.0, 1.0]) * rng.normal(0.0, speed / 3), speed),
        skid=wave(rng.choice([0.0, 0.0, 1.0]) * rng.normal(0.0, swing / 3), swing * rng.choice([0.0, 1.0])),
        sunk=wave(static, static * rng.uniform(0.0, 0.98)),
    )


@jit
def value(wave: Array, phase: float) -> float:
    """Return the value of a periodic signal at a phase [rad]."""
    found = wave[0]
    for k in range(HARMONICS):
        found += wave[1 + 2 * k] * np.sin((k + 1) * phase + wave[2 + 2 * k])
    return float(found)


@jit
def drive(tyres: TyreSet, ground: Ground, cycle: Cycle, steps: int, periods: int) -> tuple[float, float]:
    """Return the work of the ground on a wheel, and the integral of the absolute power, over the last period [J]."""
    i, dt = cycle.wheel, cycle.period / steps
    bristle, wrench, report, before = np.zeros(4), np.zeros(6), np.zeros(6), np.zeros(6)
    work, moved = 0.0, 0.0
    for k in range(steps * periods):
        phase = 2 * pi * (k + 0.5) / steps
        sunk = value(cycle.sunk, phase + pi / steps)
        ahead, aside = value(cycle.ahead, phase), value(cycle.aside, phase)
        spin = (ahead + value(cycle.skid, phase)) / (tyres.radius[i] - sunk / 3.0)
        motion = WheelMotion((0.0, 0.0, tyres.radius[i] - sunk), (0.0, 1.0, 0.0), (ahead, aside, 0.0), (0.0, spin, 0.0))
        before[:] = wrench
        wheel_step(tyres, i, ground, motion, dt, bristle, wrench, report)
        if k >= steps * (periods - 1):
            middle = 0.5 * (wrench + before)
            power = middle[0] * ahead + middle[1] * aside + middle[4] * spin
            work += power * dt
            moved += abs(power) * dt
    return work, moved


def gains(tyre: TyreBase, motions: list[Cycle]) -> Array:
    """Return two energies per period for each motion of a wheel, shape (motions, 2) [J]: work of the ground, and
    integral of the magnitude of the power."""
    ground, tyres = Flat().ground(), tyre_set(tyre, TRACTOR)
    tyres.damping[:] = 0.0  # damping would reduce the load to zero
    steps = [max(300, round(one.period / DT_S)) for one in motions]
    return np.array([drive(tyres, ground, one, n, PERIODS) for one, n in zip(motions, steps, strict=True)])


def tool_gains(motions: list[Cycle]) -> Array:
    """Return two energies per period for each motion of a soil tool, shape (motions, 2) [J]: work of the soil, and
    integral of the magnitude of the power."""
    law, found = Tool(suction_share=0.0).law(), []
    for one in motions:
        memory, before, work, moved, n = np.zeros(MEMORIES), np.zeros(3), 0.0, 0.0, 300
        for k in range(n * PERIODS):
            phase, dt = 2 * pi * (k + 0.5) / n, one.period / n
            depth = law.depth * value(one.sunk, phase + pi / n) / one.sunk[0]
            v = np.array([value(one.ahead, phase) + value(one.skid, phase), value(one.aside, phase), 0.0])
            force = np.array(soil_on_tool(law, 1.0, v[0], v[1], depth, dt, memory))
            if k >= n * (PERIODS - 1):
                power = 0.5 * (force + before) @ v
                work, moved = work + power * dt, moved + abs(power) * dt
            before = force
        found.append((work, moved))
    return np.array(found)


def run(m: Trial) -> Iterator[Check]:
    """Yield checks that the ground does no positive work in random periodic motions, for a wheel with each tyre, with
    and without damping, and for a soil tool."""
    rng = np.random.default_rng(SEED)
    motions = [cycle(rng) for _ in range(BRIEFLY if m.quick else MOTIONS)]
    some = motions[: len(motions) // 10]
    found = []
    for tyre in (*force_tyres(), Ruts()):
        for damped, law in (("", tyre), (", undamped", tyre.model_copy(update={"bristle_damping_s": 0.0}))):
            found.append((tyre.kind, f"{len(motions)} motions{damped}", gains(law, motions)))
    for subject, words, gained in [*found, ("tool", f"{len(some)} motions", tool_gains(some))]:
        about = m.about(f"maximum energy gain divided by the energy exchanged, {words}", subject)
        yield about.between(float((gained[:, 0] / np.maximum(gained[:, 1], 1e-9)).max()), -1.0, ROUNDING)
