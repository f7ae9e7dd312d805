"""Machine faults: effects on the plant, overlaps, and faults rejected before a run."""

import numpy as np
import pytest
from scripted import scripted

from agrobot_mj import load_scenario
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import NOMINAL, TICK_S, PointMass
from agrobot_mj.faults import Drawbar, Payload, SideForce, SoftTyre, loadings
from agrobot_mj.scenario.schema import resolve
from agrobot_mj.simulation.loop import Loop, build_plant


def days(*faults, seconds=10.0, seed=1):
    return scripted(faults, round(seconds / TICK_S), seed)


def correlation_time(x):
    """Return the time in which the autocorrelation falls to 37 % [s], computed from its first lag."""
    y = x - x.mean()
    return -TICK_S / np.log((y[1:] @ y[:-1]) / (y @ y))


def test_varying_drawbar_pull_keeps_its_mean_and_stays_positive():
    pulls = np.array([day.drawbar for day in days(Drawbar(pull_n=2000, noise_share=0.5), seconds=3000)])
    assert pulls.min() > 0
    assert pulls.mean() == pytest.approx(2000, rel=0.05)
    assert pulls.std() == pytest.approx(1000, rel=0.1)
    assert correlation_time(np.log(pulls)) == pytest.approx(0.5, rel=0.15)


def test_constant_drawbar_pull_does_not_vary_with_time():
    assert {day.drawbar for day in days(Drawbar(pull_n=1234.5))} == {1234.5}


def test_wind_gusts_vary_about_the_mean_wind_force():
    forces = np.array([day.side_force for day in days(SideForce(force_n=-400, gust_share=0.3), seconds=4000)])
    assert forces.mean() == pytest.approx(-400, rel=0.05)
    assert forces.std() == pytest.approx(120, rel=0.1)
    assert correlation_time(forces) == pytest.approx(2.0, rel=0.2)


def test_masses_of_payloads_at_different_positions_add_up():
    front, rear = Payload(mass_kg=80, ahead_m=1.6, end_s=1.0), Payload(mass_kg=-50, ahead_m=-0.4)
    first, *_, last = days(front, rear)
    assert first.payload == (PointMass(80, 1.6, 0, 0.7), PointMass(-50, -0.4, 0, 0.7))
    assert last.payload == (PointMass(-50, -0.4, 0, 0.7),)
    assert loadings((front, rear)) == [(0, first.payload), (0, last.payload), (1, first.payload)]


def test_two_soft_tyres_are_accepted_but_one_tyre_twice_is_rejected():
    first, *_ = days(SoftTyre(wheel="fl"), SoftTyre(wheel="rr", stiffness_share=0.5, rolling_share=2.0))
    assert first.tyre_stiffness == (0.4, 1, 1, 0.5)
    assert first.tyre_rolling == (1.6, 1, 1, 2.0)
    resolve({"fault": [{"kind": "soft_tyre", "wheel": wheel} for wheel in ("fl", "fr")]}, "x")
    with pytest.raises(ScenarioError, match=r"fault\[1\]: this .* overlaps fault\[0\]"):
        resolve({"fault": [{"kind": "soft_tyre", "wheel": "fl"}] * 2}, "x")


def test_machine_faults_of_zero_size_have_no_effect():
    nothing = (
        Payload(mass_kg=0),
        Drawbar(pull_n=0, noise_share=1),
        SideForce(force_n=0),
        SoftTyre(stiffness_share=1, rolling_share=1),
    )
    assert set(days(*nothing)) == {NOMINAL}


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        (
            [{"mass_kg": -600.0, "ahead_m": 0.5, "start_s": 30.0}],
            r"fault\[0\]\.mass_kg: only -10 of 59",
        ),
        (
            [{"mass_kg": -200.0, "ahead_m": 1.8}],
            r"fault\[0\]\.mass_kg: .*not physical .* at most \d+ % of this mass there",
        ),
        (
            [
                {"mass_kg": 300.0, "ahead_m": 0.5, "end_s": 5.0},
                {"mass_kg": -500.0, "ahead_m": 0.5, "up_m": 0.6},
                {"mass_kg": -150.0, "ahead_m": 0.5, "up_m": 0.65},
            ],
            r"fault\[0\]\.mass_kg: ",
        ),
    ],
    ids=["too much", "too far out", "once the other has gone"],
)
def test_payload_that_gives_an_unphysical_tractor_is_rejected(tables, message):
    scenario = resolve({"fault": [{"kind": "payload", **table} for table in tables]}, "mine")
    with pytest.raises(ScenarioError, match=message):
        build_plant(scenario)


def test_machine_settles_with_a_payload_that_is_present_from_the_start():
    loaded = load_scenario("straight_line").changed({"fault": [{"kind": "payload", "mass_kg": 200.0}]})
    loop = Loop(loaded)
    pitch = loop.truth.pitch
    for _ in range(20):
        drive = loop.tick().drive
        loop.advance(drive._replace(pedal_voltage=6.0))
    assert pitch < -0.005  # it sits on its rear tyres from the start
    assert loop.truth.pitch == pytest.approx(pitch, abs=5e-4)
