"""Each manoeuvre detects a plant that violates its theory."""

import numpy as np
import pytest

from agrobot_mj.estimation import pose_estimator
from agrobot_mj.estimation.kalman import filterpy_ekf
from agrobot_mj.extensions.bench.manoeuvres import (
    antenna_lean,
    base,
    coasting,
    convergence,
    cornering,
    energy,
    filters,
    implements,
    kingpins,
    loads,
    parking,
    ruts,
    side_slope,
    size,
    sliding,
    soak,
    standing,
    steering,
    step_steer,
    tipping,
)
from agrobot_mj.extensions.bench.manoeuvres.base import Trial, force_tyres
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.hydraulics import Cylinder, Valve
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.driver import LEVEL, STOCK, mujoco_plant
from agrobot_mj.plants.mujoco import plant, settling
from agrobot_mj.simulation.run import run
from agrobot_mj.terrain import Slope
from agrobot_mj.tyres import Contact, Linear, MagicFormula, Ruts, Soil
from agrobot_mj.tyres.magic_formula import AxleTyre, Curve

SOFT = Linear(front_cornering_stiffness_n_rad=6_600, rear_cornering_stiffness_n_rad=13_400)  # A tenth too soft
STANDARD = Linear()
traction = sliding.traction


@pytest.fixture(autouse=True)
def one_tyre(monkeypatch):
    """Restrict the manoeuvres to the linear tyre and to shorter runs."""
    for module in (coasting, convergence, loads, parking, side_slope, soak, tipping):
        monkeypatch.setattr(module, "tyres", lambda *without: [Linear()])
    monkeypatch.setattr(energy, "force_tyres", lambda: [Linear()])
    monkeypatch.setattr(energy, "BRIEFLY_S", 2.5)


def swap(monkeypatch, change):
    """Replace the simulated plant: `change` receives the arguments of `mujoco_plant` and returns the arguments to
    use."""
    monkeypatch.setattr(
        base, "mujoco_plant", lambda tyre, terrain=LEVEL, *a, **k: mujoco_plant(*change(tyre, terrain, *a), **k)
    )


def failures(module):
    """Return the quantities outside their acceptance limits in the quick version of a manoeuvre."""
    driven = Trial(module.__name__, quick=True).drive(module.run)
    return {check.quantity for check in driven.checks if not check.passed}


def test_sliding_check_detects_wrong_force_direction_and_traction(monkeypatch):
    monkeypatch.setattr(sliding, "force_tyres", lambda: [Soil(sliding_anisotropy=1.0)])
    assert failures(sliding) == {"deviation of the force from the sliding direction, locked, 20-80 deg to its heading"}
    monkeypatch.setattr(sliding, "force_tyres", lambda: [Soil()])
    monkeypatch.setattr(sliding, "traction", lambda soil, s: traction(soil, 0.7 * s))
    assert failures(sliding) == {f"net traction divided by load at {s} % slip" for s in (30, 60, 90, 95)}


def test_filter_check_detects_a_wrong_gain(monkeypatch):
    monkeypatch.setattr(
        pose_estimator, "filterpy_ekf", lambda x, P, F, Q, y, H, R: filterpy_ekf(x, P, F, Q, y, H, 1.01 * R)
    )
    assert {"ekf, position", "ekf_bias, covariance"} <= failures(filters)


def test_parking_check_detects_contact_creep():
    plant, _ = mujoco_plant(Contact(), Slope(grade_deg=15, direction_deg=0))
    moved, creep = parking.drift(plant, 20.0)
    assert moved > 5.0
    assert creep == pytest.approx(6 * moved, rel=0.1)


def test_parking_check_detects_a_plant_that_creeps(monkeypatch):
    swap(monkeypatch, lambda tyre, terrain, *rest: (Contact(), terrain, *rest))
    assert len(failures(parking)) == 6


def test_load_check_detects_a_slope_error_of_half_a_degree(monkeypatch):
    swap(monkeypatch, lambda tyre, t, *rest: (tyre, t.model_copy(update={"grade_deg": 15.5}), *rest))
    assert {"front axle, uphill on 15 deg", "upper rear wheel, across on 15 deg"} <= failures(loads)


def test_tipping_check_detects_a_higher_centre_of_gravity(monkeypatch):
    high = Machine(tractor=TractorParameters(cg_height_m=0.65))
    swap(monkeypatch, lambda tyre, terrain, *rest: (tyre, terrain, high))
    assert failures(tipping)


def test_coasting_check_detects_a_wrong_wheel_inertia(monkeypatch):
    free = Machine(driveline=Driveline(connected=False), tractor=TractorParameters(rear_wheel_mass_kg=75))
    swap(monkeypatch, lambda tyre, terrain, *rest: (tyre, terrain, free))
    monkeypatch.setattr(coasting, "spin_inertia", lambda plant: np.array([0.9, 0.9, 4.7, 4.7]))
    assert failures(coasting)


def test_side_slope_check_detects_a_softer_tyre(monkeypatch):
    swap(monkeypatch, lambda tyre, *rest: (SOFT, *rest))
    assert {"crab angle of the heading, 5 deg", "mean crab angle, 5 deg"} <= failures(side_slope)


def test_size_check_detects_tyres_and_cylinder_of_another_machine_size(monkeypatch):
    """The tyres have the reference loads of a compact tractor, and the cylinder a low relief pressure, on 2 t."""
    small = MagicFormula(
        front=AxleTyre(reference_load_n=1400.0, lateral=Curve(stiffness_per_load=5.3)),
        rear=AxleTyre(reference_load_n=2300.0, lateral=Curve(stiffness_per_load=6.6)),
        patch_half_length_m=0.08,
    )
    monkeypatch.setattr(size, "MASSES_KG", (700.0, 2000.0))
    monkeypatch.setattr(size, "TYRE", small)
    weak = Cylinder(relief_pressure_bar=5.0)
    monkeypatch.setattr(
        size, "machine_of_mass", lambda mass, grown=size.machine_of_mass: grown(mass)._replace(cylinder=weak)
    )
    assert failures(size) >= {
        "mean crab angle, 5 deg, 2 t",
        "peak force divided by static load, front, 2 t",
        "peak force divided by static load, rear, 2 t",
        "steering torque at standstill, 2 t",
    }


def linear_alone(machine=STOCK, tyre=STANDARD):
    return lambda m, **__: [("linear", *m.mujoco(tyre, machine=machine))]


def test_constant_radius_check_detects_a_softer_front_tyre(monkeypatch):
    softer = Linear(front_cornering_stiffness_n_rad=7_000)
    monkeypatch.setattr(Trial, "level_plants", linear_alone(tyre=softer))
    assert failures(cornering) == {"understeer gradient"}


def test_step_steer_check_detects_a_shorter_relaxation_length(monkeypatch):
    monkeypatch.setattr(Trial, "level_plants", linear_alone(tyre=Linear(relaxation_radii=1.0)))
    assert "overshoot" in failures(step_steer)


def test_steering_check_detects_a_different_valve(monkeypatch):
    monkeypatch.setattr(steering, "force_tyres", list)
    slow = Valve(delay_s=0.12, time_constant_s=0.11, dead_band_v=0.42, gain_left_l_min_v=3.3, pump_flow_l_min=11.5)
    monkeypatch.setattr(Trial, "level_plants", linear_alone(Machine(valve=slow)))
    missed = failures(steering)
    assert {"delay, left", "time constant, left", "dead band, right", "gain, left", "rate limit, right"} <= missed
    assert "gain, right" not in missed


def test_kingpin_check_detects_wrong_kingpin_angles_and_relief_pressure(monkeypatch):
    def other(tyre, machine):
        upright = machine.linkage.model_copy(update={"kingpin_inclination_deg": 5.0})
        strong = machine.cylinder.model_copy(update={"relief_pressure_bar": 100.0})
        return mujoco_plant(tyre, machine=machine._replace(linkage=upright, cylinder=strong))

    monkeypatch.setattr(base, "mujoco_plant", other)
    missed = failures(kingpins)
    assert missed == {"torque of the lifted weight at 20 deg", "steering rate under weak relief, parked"}


def test_energy_check_detects_a_torque_missing_from_the_balance(monkeypatch):
    def pushed(*args, **kwargs):
        plant, truth = mujoco_plant(*args, **kwargs)
        plant.data.qfrc_applied[plant.model.joint("spin_rl").dofadr[0]] = 10.0
        return plant, truth

    monkeypatch.setattr(base, "mujoco_plant", pushed)
    assert failures(energy) == {"energy residual divided by the change of kinetic energy"}


def test_energy_check_detects_a_wrong_rolling_radius(monkeypatch):
    """The energy balance of the tyre uses the loaded radius instead of the effective rolling radius."""
    monkeypatch.setattr(energy, "force_tyres", lambda: [tyre for tyre in force_tyres() if tyre.kind == "magic_formula"])

    class Wrong(energy.Wheel):
        def powers(self, velocity, spin):
            lost, damped, squeezed = super().powers(velocity, spin)
            deflection = self.plant.tyred.report[self.i, 0] / self.plant.tyred.tyres.stiffness[self.i]
            return lost - self.plant.tyred.report[self.i, 3] * deflection * float(spin @ self.axle), damped, squeezed

    monkeypatch.setattr(energy, "Wheel", Wrong)
    assert failures(energy)


def test_convergence_check_detects_a_change_of_results_by_3_percent(monkeypatch):
    monkeypatch.setattr(convergence, "lateral_rms", lambda tyre, dt, duration_s: 1.03 if dt == 0.002 else 1.0)
    assert failures(convergence) == {"change of lateral rms, 2 ms to 1 ms"}


def test_soak_test_counts_ticks_with_non_finite_values():
    plant, _ = mujoco_plant(Linear())
    plant.data.qvel[0] = np.nan
    broken, restarts = soak.soak(Trial("soak"), plant, 1.0)
    assert broken == 1
    assert restarts == 1


def test_antenna_tilt_check_detects_a_mast_ten_percent_too_short(monkeypatch):
    monkeypatch.setattr(antenna_lean, "force_tyres", lambda: [Linear()])
    monkeypatch.setattr(antenna_lean, "simulate", lambda s: run(s.changed({"tractor.antenna_height_m": 1.8})))
    assert "pd, paper's sensors, 10 deg, held" in failures(antenna_lean)


def test_rut_check_detects_different_soil_and_missing_rut_memory(monkeypatch):
    monkeypatch.setattr(ruts, "SOILS", {"sandy loam": Ruts(multipass=1.0)})
    assert failures(ruts) == {"sinkage added by the second pass, relative to the first pass, sandy loam"}
    harder = ruts.load_cell
    monkeypatch.setattr(ruts, "load_cell", lambda soil, k, *rest: harder(soil, 1.05 * k, *rest))
    assert {"pressure of a plate 10 mm deep", "pressure of a plate 30 mm deep"} <= failures(ruts)


def test_implement_check_detects_wrong_tool_drawbar_and_draught(monkeypatch):
    made = implements.Hauler.__init__

    def other(self, m, implement, *rest):
        stiffness, draught = 0.8 * implement.tool.cornering_stiffness_n_deg, 1.05 * implement.tool.draught_scale
        tool = implement.tool.model_copy(update={"cornering_stiffness_n_deg": stiffness, "draught_scale": draught})
        bar = {"axle_behind_m": 1.3 * implement.axle_behind_m} if implement.kind == "drawn" else {}
        made(self, m, implement.model_copy(update={"tool": tool, **bar}), *rest)

    monkeypatch.setattr(implements.Hauler, "__init__", other)
    found = failures(implements)
    for words in ("mounted tool, yaw gain", "trailer, angle at the pin", "radius of its axle", "draught of a chisel"):
        assert any(words in quantity for quantity in found), words


def test_standstill_check_detects_drop_creep_and_weak_brake(monkeypatch):
    monkeypatch.setattr(standing, "QUICK", ("orchard",))
    monkeypatch.setattr(standing, "BRIEFLY_S", 3.0)
    monkeypatch.setattr(standing, "families", lambda: {"plant.tyre": {"contact": Contact}})
    assert failures(standing) == set()
    with monkeypatch.context() as dropped:
        dropped.setattr(settling, "TILT_DEG_S", 1e6)
        assert failures(standing) == {"steepest slope across which it starts, orchard"}
    with monkeypatch.context() as slack:
        slack.setattr(plant, "STICKING_CONTACT", 1.0)
        assert failures(standing) == {"drift under the brake, 10 deg"}
    torques = Driveline.brake_torques
    monkeypatch.setattr(Driveline, "brake_torques", lambda self, tractor: 0.8 * torques(self, tractor))
    assert failures(standing) == {"deceleration by the brake, orchard"}
