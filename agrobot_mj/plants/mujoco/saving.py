"""The state of a MuJoCo tractor between two ticks, complete to the last bit.

MuJoCo's own state for integration (`mjSTATE_INTEGRATION`: positions, velocities, actuators, forces applied, warm start
of the solver), and beside it what the last step has left for the log: forces of the actuators, readings of the contact
sensors, velocities of the bodies, the count of warnings. Poses of the bodies follow from the positions.
"""

from typing import NamedTuple

import mujoco

from agrobot_mj.core.signals import Array, Conditions
from agrobot_mj.terrain.memory import AnyArray, SavedSoil

INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION


class MujocoState(NamedTuple):
    """A saved `MujocoPlant`."""

    physics: Array
    """MuJoCo's state for integration."""
    left: tuple[AnyArray, ...]
    """Results of the last step in MjData, and the friction of the geoms."""
    memories: tuple[AnyArray, ...]
    """What the tick writes in place: tyres, loads, valve, drive, samples."""
    conditions: Conditions
    """Faults and disturbances of the last tick."""
    ticks: int
    """Ticks since the reset."""
    soil: SavedSoil
    """What the soil remembers."""


def step_results(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[AnyArray, ...]:
    """Return the views of results of a step that the log reads, or the next step before it computes them."""
    found = data.actuator_force, data.sensordata, data.cvel, data.subtree_com
    return *found, model.geom_friction, data.warning.number
