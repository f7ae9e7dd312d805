"""Scenario values that do not fit the size of the machine are reported by key; shipped scenarios have no hints."""

import sys

import pytest

from agrobot_mj.core.resources import SCENARIOS, machine_files
from agrobot_mj.scenario.hints import hints
from agrobot_mj.scenario.loading import load_scenario

LARGE = {
    **{"tractor.mass_kg": 3600.0, "tractor.wheelbase_m": 2.3, "tractor.track_m": 1.6},
    **{"tractor.yaw_inertia_kg_m2": 6000.0, "tractor.roll_inertia_kg_m2": 2000.0},
    **{"tractor.pitch_inertia_kg_m2": 5000.0, "tractor.front_wheel_radius_m": 0.5},
    **{"tractor.rear_wheel_radius_m": 0.72, "tractor.front_wheel_width_m": 0.3, "tractor.rear_wheel_width_m": 0.42},
    **{"driveline.torque_limit_n_m": 15000.0, "driveline.power_limit_kw": 55.0},
}


def hinted_keys(changes, **more):
    return [line.split(": ")[0] for line in hints(load_scenario("side_slope", LARGE | changes | more))]


@pytest.mark.parametrize("name", sorted(file.stem for file in SCENARIOS.glob("*.toml")))
def test_shipped_scenarios_have_no_hints(name):
    assert hints(load_scenario(name)) == []


@pytest.mark.parametrize("kind", ["magic_formula", "soil", "ruts"])
def test_large_machine_with_specified_sizes_has_no_hints(kind):
    assert hinted_keys({"plant.tyre.kind": kind}) == []


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"plant.tyre.rear.reference_load_n": 2300.0}, "plant.tyre.rear.reference_load_n"),
        ({"plant.tyre.front.reference_load_n": 20000.0}, "plant.tyre.front.reference_load_n"),
        ({"implement": {"kind": "mounted", "mass_kg": 1500.0}}, "plant.tyre.front.reference_load_n"),
        ({"tractor.rear_wheel_radius_m": 0.3, "tractor.rear_wheel_width_m": 0.2}, "tractor.rear_wheel_radius_m"),
        ({"tractor.front_tyre_stiffness_n_m": 5e4}, "tractor.front_tyre_stiffness_n_m"),
        ({"driveline.torque_limit_n_m": 3000.0}, "driveline.torque_limit_n_m"),
        ({"driveline.power_limit_kw": 2.0}, "driveline.power_limit_kw"),
        ({"steering.cylinder.relief_pressure_bar": 8.0}, "steering.cylinder.relief_pressure_bar"),
        ({"steering.cylinder.bore_mm": 30.0}, "steering.cylinder.bore_mm"),
        ({"implement": {"kind": "drawn", "mass_kg": 6000.0}}, "implement"),
        ({"plant.tyre.kind": "soil", "plant.tyre.cone_index_kpa": 80.0}, "plant.tyre.cone_index_kpa"),
        ({"plant.tyre.kind": "ruts", "plant.tyre.k_phi_kn": 100.0, "plant.tyre.k_c_kn": 0.0}, "plant.tyre.k_phi_kn"),
    ],
)
def test_hint_names_the_key_of_a_value_that_does_not_fit_machine_size(changes, key):
    assert key in hinted_keys(changes)


@pytest.mark.parametrize(("wheelbase", "mass", "light"), [(2.8, 750, True), (3.4, 300, True), (1.0, 100, False)])
def test_hint_reports_a_machine_too_light_for_its_wheels(wheelbase, mass, light):
    lines = hints(load_scenario("circle", {"tractor.wheelbase_m": wheelbase, "tractor.mass_kg": mass}))
    assert [line.split(" is too light")[0] for line in lines] == [f"tractor.mass_kg: {mass} kg"] * light


@pytest.mark.parametrize("implement", ["none", "mounted", "drawn"])
@pytest.mark.parametrize("machine", machine_files())
def test_no_shipped_machine_is_too_light_for_its_wheels(machine, implement):
    lines = hints(load_scenario("circle", {"machine": machine, "implement": {"kind": implement}}))
    assert not [line for line in lines if line.startswith("tractor")]


@pytest.mark.parametrize("table", ["plant.tyre", "plant"])
def test_hint_reports_stiffness_values_of_another_machine_size(table):
    kind = {"plant.tyre.kind": "linear"} if table == "plant.tyre" else {"plant.kind": "bicycle", "terrain.kind": "flat"}
    keys = [f"{table}.{axle}_cornering_stiffness_n_rad" for axle in ("front", "rear")]
    of_compact, measured = (
        dict(zip(keys, [pair * C_alpha for C_alpha in each], strict=True))
        for pair in [1 if table == "plant.tyre" else 2]
        for each in ((7400.0, 15e3), (40e3, 70e3))
    )
    assert hinted_keys(kind, **of_compact) == keys
    assert hinted_keys(kind, **measured) == hinted_keys(kind) == []


def test_hint_states_the_value_of_a_clamped_tyre_coefficient():
    """A load of 10.9 kN on a tyre for 2.3 kN gives 1 - 0.25 x 3.76 for the stiffness, and 0.7 for the grip."""
    (line,) = hints(load_scenario("side_slope", LARGE | {"plant.tyre.rear.reference_load_n": 2300.0}))
    assert "carries 10948 N, 4.8 times the reference load of 2300 N" in line
    assert line.endswith("beyond it stiffness per load stay at 0.2 times the reference")


@pytest.mark.parametrize("ends", [False, True])
def test_errors_raised_while_plugin_tyres_compute_hints_are_ignored(monkeypatch, ends):
    """The error is reported when the tractor is built."""
    monkeypatch.setattr("agrobot_mj.tyres.Linear.structure", lambda self: sys.exit(3) if ends else None)
    assert hints(load_scenario("side_slope", {"plant.tyre.kind": "linear"})) == []
