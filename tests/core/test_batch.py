"""Tests of laws in Warp, on its CPU: equal to the laws themselves within single precision."""

from typing import Any

import numpy as np
import pytest

from agrobot_mj.core import batch
from agrobot_mj.core.signals import Array
from agrobot_mj.machine.hydraulics import Valve, ValveLaw, loaded_flow, static_flow, valve_law
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.tyres.base import Footing, Slip, TyreBase, TyreForce, TyreLaw
from agrobot_mj.tyres.linear import Linear
from agrobot_mj.tyres.magic_formula import MagicFormula
from agrobot_mj.tyres.soil import Soil

warp = pytest.importorskip("warp", reason="needs warp; pip install agrobot-mj[batch]")

N = 10_000
TYRES = (
    Linear(),
    MagicFormula(),
    MagicFormula(sliding_anisotropy=1),
    Soil(),
    Soil(ply="radial", sliding_anisotropy=0.5),
)


def slips(load: float) -> list[Slip]:
    """States from rolling freely to locked and sliding sideways, the first without any slip."""
    rng = np.random.default_rng(7)
    x, y = rng.choice([-1.0, 1.0], (2, N)) * 10 ** rng.uniform(-4, 0.3, (2, N))
    x[0] = y[0] = 0.0
    rest = rng.uniform([0.2 * load, 0.005, 0.0, 0.2, 2e5], [3 * load, 0.05, 5.0, 1.2, 2e6], (N, 5))
    travel = rng.choice([-1.0, 1.0], N)
    single = np.column_stack((x, y, rest, travel)).astype(np.float32).astype(float).tolist()
    return [Slip(x, y, W, d, v, Footing(grip, CI), t) for x, y, W, d, v, grip, CI, t in single]


def in_warp(law: TyreLaw, states: list[Slip]) -> Array:
    """Forces of a law in Warp, a row each, as `TyreForce` has them."""
    force, law_struct = batch.as_function(type(law).force, type(law)), batch.as_struct(type(law))
    slip_struct, force_struct = batch.as_struct(Slip), batch.as_struct(TyreForce)

    @warp.kernel
    def each(law: law_struct, states: warp.array(dtype=slip_struct), forces: warp.array(dtype=force_struct)) -> None:
        k = warp.tid()
        forces[k] = force(law, states[k])

    forces = warp.zeros(len(states), dtype=force_struct, device="cpu")
    given = warp.array([batch.as_value(slip) for slip in states], dtype=slip_struct, device="cpu")
    warp.launch(each, len(states), [batch.as_value(law), given, forces], device="cpu")
    return np.array(forces.numpy().tolist())


@pytest.mark.parametrize("tyre", TYRES, ids=lambda tyre: f"{tyre.kind}-{getattr(tyre, 'sliding_anisotropy', 0):g}")
def test_warp_gives_the_force_of_a_tyre_law(tyre: TyreBase) -> None:
    tractor = TractorParameters()
    for wheel, law in zip(tractor.wheels, tyre.coefficients(tractor), strict=True):
        states = slips(wheel.load)
        expected, found = np.array([law.force(slip) for slip in states]), in_warp(law, states)
        size, load = np.hypot(expected[:, 0], expected[:, 1]), np.array([slip.load for slip in states])
        error = np.hypot(*(found - expected).T[:2])
        # at the least slips 1 - exp(-rho) of soil keeps few digits in single precision: then against the load
        assert np.all(error <= np.maximum(1e-5 * size, 1e-7 * load))
        assert np.allclose(found[:, 2:], expected[:, 2:], rtol=1e-5, atol=1e-6)
        assert np.ptp(expected[:, 1]) > load.mean()  # the states do reach the grip


def test_warp_gives_the_flow_of_a_valve_law() -> None:
    law, _ = valve_law(Valve(supply_pressure_bar=120.0), 0.002)
    steady, loaded, law_struct = (
        batch.as_function(static_flow),
        batch.as_function(loaded_flow),
        batch.as_struct(ValveLaw),
    )

    @warp.kernel
    def each(law: law_struct, inputs: warp.array2d(dtype=float), flows: warp.array2d(dtype=float)) -> None:
        k = warp.tid()
        flows[k, 0] = steady(law, inputs[k, 0])
        flows[k, 1] = loaded(law, flows[k, 0], inputs[k, 1])

    inputs = np.random.default_rng(7).uniform([0.0, -2e7], [12.0, 2e7], (N, 2)).astype(np.float32)
    flows: Any = warp.zeros((N, 2), dtype=float, device="cpu")
    warp.launch(each, N, [batch.as_value(law), warp.array(inputs, dtype=float, device="cpu"), flows], device="cpu")
    expected = [(flow := static_flow(law, v), loaded_flow(law, flow, p)) for v, p in inputs.astype(float).tolist()]
    assert np.all(np.abs(flows.numpy() - np.array(expected)) <= 1e-5 * law.saturation)
    assert len(np.unique(np.sign(expected))) == 3
