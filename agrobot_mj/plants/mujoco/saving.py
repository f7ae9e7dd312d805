"""Bit-exact state of a MuJoCo tractor between two ticks, for saving and restoring.

The state consists of MuJoCo's integration state (`mjSTATE_INTEGRATION`: positions, velocities, actuators, applied
forces, warm start of the solver) and of results of the last step used by the log: actuator forces, contact sensors,
body velocities, number of warnings. Body poses are computed from the positions.
"""

from typing import NamedTuple

import mujoco

from agrobot_mj.core.signals import Array, Conditions
from agrobot_mj.terrain.memory import AnyArray, SavedSoil

INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION


class MujocoState(NamedTuple):
    """Saved state of a `MujocoPlant`."""

    physics: Array
    left: tuple[AnyArray, ...]  # Results of the last step in MjData, and friction of the geoms
    memories: tuple[AnyArray, ...]
    """Copies of arrays outside MjData that a tick modifies in place, such as the states of tyres, valve and drive."""
    conditions: Conditions
    ticks: int
    soil: SavedSoil


def step_results(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[AnyArray, ...]:
    """Return views of the step results that the log uses, or that the next step uses before it updates them."""
    found = data.actuator_force, data.sensordata, data.cvel, data.subtree_com
    return *found, model.geom_friction, data.warning.number
