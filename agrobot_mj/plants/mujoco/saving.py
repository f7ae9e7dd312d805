"""Bit-exact state of a MuJoCo tractor between two ticks.

It consists of MuJoCo's integration state (`mjSTATE_INTEGRATION`: positions, velocities, actuators, applied forces, warm
start of the solver), and results of the last step used by the log: actuator forces, contact sensors, body velocities,
number of warnings. Body poses follow from the positions.
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
    """Arrays that the tick writes in place: tyres, loads, valve, drive, samples."""
    conditions: Conditions
    """Faults and disturbances of the last tick."""
    ticks: int
    """Ticks since the reset."""
    soil: SavedSoil
    """Soil memory."""


def step_results(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[AnyArray, ...]:
    """Return the views of results of a step that the log reads, or the next step before it computes them."""
    found = data.actuator_force, data.sensordata, data.cvel, data.subtree_com
    return *found, model.geom_friction, data.warning.number
