"""Simulation controlled by an external program: velocity requests, and rejected commands."""

import pytest

from agrobot_mj import Simulation
from agrobot_mj.core.errors import CommandError
from agrobot_mj.extensions.links.agopengps_guidance import Actuation
from agrobot_mj.extensions.links.cmd_vel import VelocityRequest

SHORT = {"duration_s": 3.0, "plant.kind": "bicycle"}


def test_external_program_controls_the_tractor_by_velocity_requests():
    sim = Simulation("circle", SHORT | {"guidance.kind": "cmd_vel", "duration_s": 6.0})
    sim.reset()
    while not sim.done:
        sim.drive(VelocityRequest(speed=1.0, yaw_rate=-0.1, age=0.0))
    assert sim.truth.yaw_rate == pytest.approx(-0.1, abs=0.01)
    assert set(sim.log().column("cmd_yaw_rate")) == {-0.1}


def test_simulation_command_unsuited_to_the_guidance_law_is_rejected():
    sim = Simulation("circle", SHORT | {"guidance.kind": "cmd_vel"})
    sim.reset()
    with pytest.raises(TypeError, match="request: must be of type VelocityRequest, got Actuation"):
        sim.drive(Actuation())
    own = Simulation("circle", SHORT)
    own.reset()
    with pytest.raises(CommandError, match=r'guidance\.kind: "kinematic" has no external program'):
        own.drive(VelocityRequest())
    own.step()  # and the run goes on
