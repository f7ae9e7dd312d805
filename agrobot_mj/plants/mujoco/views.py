"""Inputs of the compiled loop: numpy views of the arrays of an MjModel and MjData, and indices into these arrays."""

from typing import NamedTuple

import mujoco
import numpy as np

from agrobot_mj.core.signals import WHEELS, Array, Index

CHASSIS = 1
"""Body id of the chassis, the first body after the world."""
IMPLEMENT = "implement"


class Views(NamedTuple):
    """Arrays of an MjModel and MjData that the compiled loop reads and writes, and indices into these arrays."""

    model: int
    data: int
    ctrl: Array
    act: Array
    torques: Array
    """Torques of the actuators in the last step, shape (2,) [N m]."""
    qpos: Array
    qvel: Array
    xpos: Array
    xmat: Array
    xipos: Array
    cvel: Array
    root_com: Array
    """Centre of mass of the tractor, the reference point of `cvel`, shape (3,)."""
    implement_com: Array
    """Centre of mass of the implement with its wheels, or of the tractor without an implement, shape (3,)."""
    xfrc: Array
    wheels: Index
    """Body ids of the wheels, shape (4,)."""
    steer_q: int
    """Index of the virtual steering angle in qpos."""
    spins_q: Index
    """Indices of the driven rear wheels' angles in qpos, shape (2,)."""
    knuckles_q: Index
    """Indices of the left and right knuckle angles in qpos, shape (2,)."""
    steer_v: int
    """Index of the virtual steering rate in qvel."""
    spins_v: Index
    """Indices of the driven rear wheels' rates in qvel, shape (2,)."""
    fronts_q: Index
    """Indices of the front wheels' angles in qpos, shape (2,)."""
    fronts_v: Index
    """Indices of the front wheels' rates in qvel, shape (2,)."""


def views_of(model: mujoco.MjModel, data: mujoco.MjData) -> Views:
    """Return the views of a tractor's model and data, which must exist as long as the views are used."""
    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, IMPLEMENT)
    hung = CHASSIS if found < 0 else found
    return Views(
        model=model._address,
        data=data._address,
        ctrl=data.ctrl,
        act=data.act,
        torques=data.actuator_force,
        qpos=data.qpos,
        qvel=data.qvel,
        xpos=data.xpos,
        xmat=data.xmat,
        xipos=data.xipos,
        cvel=data.cvel,
        root_com=data.subtree_com[CHASSIS],
        implement_com=data.subtree_com[hung],
        xfrc=data.xfrc_applied,
        wheels=np.array([model.body(f"wheel_{w}").id for w in WHEELS], dtype=np.int64),
        steer_q=int(model.joint("steer").qposadr[0]),
        spins_q=np.array([model.joint(f"spin_{w}").qposadr[0] for w in ("rl", "rr")], dtype=np.int64),
        knuckles_q=np.array([model.joint(f"steer_{w}").qposadr[0] for w in ("fl", "fr")], dtype=np.int64),
        steer_v=int(model.joint("steer").dofadr[0]),
        spins_v=np.array([model.joint(f"spin_{w}").dofadr[0] for w in ("rl", "rr")], dtype=np.int64),
        fronts_q=np.array([model.joint(f"spin_{w}").qposadr[0] for w in ("fl", "fr")], dtype=np.int64),
        fronts_v=np.array([model.joint(f"spin_{w}").dofadr[0] for w in ("fl", "fr")], dtype=np.int64),
    )
