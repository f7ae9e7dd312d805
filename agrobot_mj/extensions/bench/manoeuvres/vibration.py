"""Wheel at rest with an oscillating load

A rear wheel rests on untouched soil with its static load. Then the load oscillates by a few per cent, 8 times per
second for a minute. Soil is elastic up to the maximum load that it has carried before. The rut must therefore be as
deep as after a single application of the maximum load, and less than 1 mm deeper than without oscillation. Lifting and
lowering the wheel is a different case: N complete loadings sink a plate to N^(1/a) times the first sinkage, with the
exponent a of the multipass law. A wheel sinks less than a plate, because its load spreads as its rut grows.
"""

from collections.abc import Iterator
from math import pi, sin
from typing import NamedTuple

from agrobot_mj.core.kernels import jit
from agrobot_mj.core.vectors import Vector
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.terrain.grid import plane
from agrobot_mj.terrain.memory import SoilMemory, rut_map
from agrobot_mj.tyres import Ruts
from agrobot_mj.tyres.bearing import Bearing, Tread, press
from agrobot_mj.tyres.laws import treads, with_soil_memory

TRACTOR = TractorParameters()
LOAD_N = TRACTOR.rear_axle_load / 2
DT_S = 0.002
LOADED_S, DURATION_S, BRIEFLY_S = 1.0, 60.0, 20.0
"""Time for applying the load, and durations of the oscillation in the full and in the quick suite [s]."""
FREQUENCY_HZ = 8.0
SWINGS = (0.01, 0.05)  # Amplitudes of the load oscillation divided by the mean load [-]
DEEPER_MM, SAME_MM = 1.0, 0.1
"""Maximum depth that oscillation adds to a rut, and maximum deviation from the rut under a constant peak load [mm]."""
COUNT = 5  # Number of full load cycles
FRAME = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
STIFFNESS = 2e6  # Stiffness by which the iteration converts a change of load to a change of depth [N/m]


class Loading(NamedTuple):
    """Load of a wheel at rest over time: a mean value and an oscillation."""

    mean: float  # Mean load [N]
    swing: float  # Amplitude of the oscillation divided by the mean [-]
    frequency: float  # Frequency of the oscillation [Hz]
    seconds: float  # Duration of the oscillation [s]


@jit
def stand(soil: Bearing, tread: Tread, memory: SoilMemory, loading: Loading, depth: float) -> float:
    """Apply an oscillating load to a wheel at the origin. Return its final depth below the untouched ground [m]."""
    place: Vector = (0.0, 0.0, 0.0)
    for k in range(round((LOADED_S + loading.seconds) / DT_S)):
        t = k * DT_S
        swing = loading.swing * sin(2 * pi * loading.frequency * (t - LOADED_S)) if t > LOADED_S else 0.0
        aim = loading.mean * min(t / LOADED_S, 1.0) * (1.0 + swing)
        # iterate the depth until the soil carries the load within a thousandth
        for _ in range(200):
            lacking = aim - press(soil, tread, memory, place, FRAME, max(depth, 1e-6), 0.0).load
            depth += lacking / STIFFNESS
            if abs(lacking) < 1e-3 * loading.mean:
                break
    return depth


def rut(tyre: Ruts, loadings: list[Loading]) -> list[float]:
    """Return the rut depth after each loading at the same location [mm]. The wheel is lifted between loadings."""
    soil = tyre.structure().bearing
    tread = treads(soil, TRACTOR)[1]
    memory, found = with_soil_memory(plane(0.0, 0.0, 2.0), soil).memory, []
    for loading in loadings:
        depth = stand(soil, tread, memory, loading, 0.0)
        found.append(1e3 * float(rut_map(memory).depth.max()))
        press(soil, tread, memory, (0.0, 0.0, 0.0), FRAME, max(depth - 0.03, 1e-6), 0.0)
    return found


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of ruts under oscillating loads and full load cycles. In quick mode, oscillations are shorter."""
    tyre, seconds = Ruts(), BRIEFLY_S if m.quick else DURATION_S
    once = Loading(LOAD_N, 0.0, FREQUENCY_HZ, 0.0)
    (still,) = rut(tyre, [once])
    for swing in SWINGS:
        (shaken,) = rut(tyre, [once._replace(swing=swing, seconds=seconds)])
        (heaviest,) = rut(tyre, [once._replace(mean=(1.0 + swing) * LOAD_N)])
        about = m.about(f"rut after {seconds:g} s of ±{100 * swing:g} % at 8 Hz", "ruts", "mm")
        yield about.close(shaken, heaviest, SAME_MM)
        yield m.about(f"additional depth due to ±{100 * swing:g} % at 8 Hz", "ruts", "mm").below(
            shaken - still, DEEPER_MM
        )
    whole, plate = rut(tyre, [once] * COUNT), COUNT ** (1 / tyre.multipass)
    about = m.about(f"rut after {COUNT} complete loadings divided by the rut after one", "ruts")
    yield about.between(whole[-1] / whole[0], 1.0 + 0.5 * (plate - 1.0), plate)
