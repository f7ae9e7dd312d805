import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.control import Kinematic, Pd
from agrobot_mj.control.cascade import SPEED_COLUMNS
from agrobot_mj.control.speed_network import SpeedNetwork, SpeedNetworkState

DT = 0.05


def _with_deficit(deficit: float, seconds: float) -> tuple[list[float], list[float]]:
    """Return speeds and commands of a tractor that drives `deficit` [m/s] below its command."""
    law, speed, wanted = SpeedNetwork(), 1.2 - deficit, 1.2
    state, speeds, commands = SpeedNetworkState(), [], []
    for _ in range(round(seconds / DT)):
        state, command = law.update(state, wanted, speed, DT)
        speed += (command - deficit - speed) * DT / 0.5
        speeds.append(speed)
        commands.append(command)
    return speeds, commands


def test_network_learns_to_compensate_for_a_speed_deficit() -> None:
    speeds, _ = _with_deficit(0.1, 120)
    assert speeds[10] < 1.14
    assert speeds[-1] == pytest.approx(1.2, abs=0.01)


def test_speed_correction_stays_within_its_bound() -> None:
    _, commands = _with_deficit(0.8, 600)
    assert max(commands) == pytest.approx(1.2 + SpeedNetwork().bound_m_s)


def test_speed_network_columns_are_appended_to_the_guidance_law_columns() -> None:
    assert Kinematic().speed_network is None
    plain, second = (law.using(Pd()).columns for law in (Kinematic(), Kinematic(speed_network=SpeedNetwork())))
    assert second == (*plain, *SPEED_COLUMNS)


def test_logged_speed_network_output_matches_the_command() -> None:
    log = run(
        load_scenario("figure_eight", {"plant.kind": "bicycle", "duration_s": 8, "guidance.speed_network.kp": 0.3})
    )
    assert np.abs(log.column("speed_tau_n")).max() > 0
    assert log.column("speed_tau_c")[-1] == pytest.approx(
        0.3
        * (
            log.column("speed_ref")[-1]
            - log.column("speed_tau_c")[-1]
            + log.column("speed_tau_n")[-1]
            - log.column("speed_hat")[-1]
        )
    )
