"""Low-level loops of a run: brake, speed loop and steering loop in one compiled call per tick."""

from typing import Any

from agrobot_mj.control.base import Situation
from agrobot_mj.control.pid import LoopsLaw, LoopsState, SteeringLoop, SteeringState, clip, loop_command_of, loops_step
from agrobot_mj.core.kernels import held, stage
from agrobot_mj.core.signals import NEUTRAL_V, TICK_S, Command, Drive, Measurement
from agrobot_mj.scenario.schema import Scenario

run_loops = stage(loops_step)


class LowLevelLoops:
    """Low-level loops of a scenario. Steering loops other than `SteeringLoop` run outside the compiled call."""

    def __init__(self, s: Scenario) -> None:
        """Prepare the low-level loops of the scenario `s`."""
        loop = s.steering.loop
        self.other = None if type(loop) is SteeringLoop else loop
        inner = loop if type(loop) is SteeringLoop else SteeringLoop()
        self.speed, self.steering, self.idle = s.speed, loop, inner.init()
        self.law = held(LoopsLaw(s.speed.parameters(), inner.parameters()))

    def drive(self, states: Any, measured: Measurement, situation: Situation, command: Command) -> Drive:
        """Update the loop states in `states`. Return the valve voltages and the brake command.

        A steering voltage or a pedal position in `command` replaces the output of the respective loop.
        """
        reference, other = situation.reference, self.other
        loop_command = loop_command_of(command, reference.vx == reference.vy == 0.0)
        steering: SteeringState = self.idle if other else states.steering
        before, steer, estimate = LoopsState(states.speed, steering, states.brake), measured.steer, situation.estimate
        after, drive = run_loops(self.law, before, loop_command, held(estimate), steer, measured.pedal, TICK_S)
        states.speed, steering, states.brake = after
        if other is None:
            states.steering = steering
            return Drive(*drive)
        states.steering, voltage = other.update(states.steering, command.steer, steer, TICK_S)
        if command.steer_voltage is not None:
            voltage = clip(command.steer_voltage, 0.0, 2 * NEUTRAL_V)
        return Drive(voltage, *drive[1:])
