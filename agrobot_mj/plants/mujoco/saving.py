"""The state of a MuJoCo tractor between two ticks, complete to the last bit.

MuJoCo's own state for integration (`mjSTATE_INTEGRATION`: positions, velocities, actuators, forces applied, warm start
of the solver), and beside it what the last step has left for the log: forces of the actuators, readings of the contact
sensors, velocities of the bodies, the count of warnings. Poses of the bodies follow from the positions.
"""

from typing import Any, NamedTuple

import mujoco
import numpy as np

from agrobot_mj.core.signals import Array, Conditions
from agrobot_mj.terrain.memory import SavedSoil

AnyArray = np.ndarray[Any, Any]
_INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION


class MujocoState(NamedTuple):
    """A saved `MujocoPlant`."""

    physics: Array
    """MuJoCo's state for integration."""
    left: tuple[AnyArray, ...]
    """What the last step has left in MjData, and the friction of the geoms."""
    memories: tuple[AnyArray, ...]
    """What the tick writes in place: tyres, loads, valve, drive, samples."""
    conditions: Conditions
    """Faults and disturbances of the last tick."""
    ticks: int
    """Ticks since the reset."""
    soil: SavedSoil
    """What the soil remembers."""


def physics_state(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """MuJoCo's state for integration."""
    state = np.empty(mujoco.mj_stateSize(model, _INTEGRATION))
    mujoco.mj_getState(model, data, state, _INTEGRATION)
    return state


def set_physics_state(model: mujoco.MjModel, data: mujoco.MjData, state: Array) -> None:
    """Put MuJoCo's state back, and the bodies where it says."""
    mujoco.mj_setState(model, data, state, _INTEGRATION)
    mujoco.mj_kinematics(model, data)


def left_by_a_step(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[AnyArray, ...]:
    """Views of what the last step has computed and the log reads, and of what is read before it is computed again."""
    found = data.actuator_force, data.sensordata, data.cvel, data.subtree_com
    return *found, model.geom_friction, data.warning.number


def copies(arrays: tuple[AnyArray, ...]) -> tuple[AnyArray, ...]:
    """Copies of the arrays."""
    return tuple(array.copy() for array in arrays)


def write(arrays: tuple[AnyArray, ...], saved: tuple[AnyArray, ...]) -> None:
    """Write saved values into arrays of the same shapes."""
    for array, values in zip(arrays, saved, strict=True):
        array[:] = values
