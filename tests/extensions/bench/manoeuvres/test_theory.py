"""Theory of the paper's tractor, compared with closed forms in limiting cases."""

from math import atan, cos, degrees, radians, sin

import numpy as np
import pytest

from agrobot_mj.core.spec import members
from agrobot_mj.extensions.bench.manoeuvres.base import force_tyres
from agrobot_mj.extensions.bench.manoeuvres.theory import Tractor, parts, understeer_gradient
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.tyres import Linear, MagicFormula, Tyre

T = TractorParameters()
STIFF = TractorParameters(front_tyre_stiffness_n_m=1e9, rear_tyre_stiffness_n_m=1e9)


def test_masses_of_body_and_front_assembly_add_up_to_the_tractor():
    b = parts(T)
    assert b.body_kg + b.front_kg == pytest.approx(T.mass_kg)
    assert b.body_kg * b.body_x + b.front_kg * T.wheelbase_m == pytest.approx(T.mass_kg * T.cg_to_rear_axle)
    assert b.body_kg * b.body_z + b.front_kg * b.front_z == pytest.approx(T.mass_kg * T.cg_height_m)
    assert b.front_z < b.pivot_z < b.body_z


@pytest.mark.parametrize("grade", [2.0, 15.0])
def test_wheel_loads_balance_the_weight_and_its_moment(grade):
    state = Tractor(STIFF).side_slope(grade, rolling=False)
    N = state.loads.wheels
    weight = T.mass_kg * GRAVITY
    assert N.sum() == pytest.approx(weight * cos(radians(grade)))
    moment = (N[1] + N[3] - N[0] - N[2]) * T.track_m / 2
    assert moment == pytest.approx(weight * sin(radians(grade)) * T.cg_height_m, rel=1e-3)


def test_tipping_axis_on_rigid_tyres_joins_tyre_and_axle_pivot():
    b, L = parts(STIFF), STIFF.wheelbase_m
    rigid = atan(STIFF.track_m / 2 * (L - b.body_x) / (L * b.body_z - b.pivot_z * b.body_x))
    tips = Tractor(STIFF).tipping_deg
    assert tips == pytest.approx(degrees(rigid), abs=0.01)
    leans = tips - Tractor().tipping_deg  # it leans on its tyres
    assert 1.6 < leans < 2.6
    ends = {"front": T.front_wheel, "rear": T.rear_wheel}
    harder = TractorParameters(**{f"{end}_tyre_stiffness_n_m": 2 * wheel.stiffness for end, wheel in ends.items()})
    assert tips - Tractor(harder).tipping_deg == pytest.approx(leans / 2, rel=0.05)
    assert tips < degrees(atan(T.track_m / 2 / T.cg_height_m)) - 5


def test_linear_tyres_give_the_understeer_gradient_of_the_paper():
    tyre = Linear()
    paper = understeer_gradient(T, 2 * tyre.front_cornering_stiffness_n_rad, 2 * tyre.rear_cornering_stiffness_n_rad)
    speeds, small_angles = np.array([3.0, 6.0, 12.0]), 300.0
    assert Tractor(T, tyre).understeer_gradient(speeds, small_angles) == pytest.approx(paper, rel=1e-3)


@pytest.mark.parametrize("tyre", force_tyres(), ids=lambda tyre: tyre.kind)
def test_tyre_forces_in_equilibrium_hold_the_tractor_on_a_side_slope(tyre):
    tractor = Tractor(T, tyre)
    state = tractor.side_slope(5.0)
    slips = (state.front_slip, state.front_slip, state.rear_slip, state.rear_slip)
    sideways = [tractor.lateral(i, slip, state.loads.wheels[i]) for i, slip in enumerate(slips)]
    assert sum(sideways) == pytest.approx(T.mass_kg * GRAVITY * sin(radians(5.0)), rel=0.01)
    assert state.front_slip > state.rear_slip > 0


def test_side_slope_steeper_than_the_tyre_grip_has_no_equilibrium():
    with pytest.raises(ValueError, match="sign"):
        Tractor(T, MagicFormula()).side_slope(44.0)


def test_rolling_resistance_shifts_side_slip_to_the_front_axle():
    rough = Linear(rolling_resistance=0.05)
    smooth = Tractor(T, Linear()).side_slope(5.0)
    braked = Tractor(T, rough).side_slope(5.0)
    assert braked.front_slip > 1.05 * smooth.front_slip
    assert braked.rear_slip < 0.97 * smooth.rear_slip


def test_every_tyre_model_with_a_force_law_is_covered():
    assert {tyre.kind for tyre in force_tyres()} == set(members(Tyre)) - {"contact", "ruts"}
