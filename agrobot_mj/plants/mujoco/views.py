"""Inputs of the compiled loop: NumPy views of the arrays in MjModel and MjData, and indices into these arrays."""

from typing import NamedTuple

import mujoco
import numpy as np

from agrobot_mj.core.signals import WHEELS, Array, Index
from agrobot_mj.terrain.memory import AnyArray

CHASSIS = 1  # Body id of the chassis, the first body after the world
IMPLEMENT = "implement"
DISABLED = mujoco.mjtDisableBit.mjDSBL_AUTORESET | mujoco.mjtDisableBit.mjDSBL_ISLAND
"""MuJoCo features disabled by `model`: reset of a diverged run, and search for islands (all bodies are one island)."""


class Coupling(NamedTuple):
    """Arrays of MjModel and MjData for the coupling of both knuckles to the crank; see the module `coupling`."""

    rows: Index
    """Ids of the two equality constraints, shape (2,), or empty if MuJoCo's solver must compute the coupling forces."""
    knuckles_v: Index  # Indices of both knuckle rates in qvel, shape (2,)
    eq_active: AnyArray
    eq_data: Array
    solref: Array  # Stiffness and damping of both couplings, per unit of the inverse inertia, shape (2, 2) [1/s2, 1/s]
    solimp: Array
    weights: Array  # Inverse inertia of each degree of freedom in the initial position, shape (nv,)
    frictionloss: Array
    stops_q: Index  # Indices of the joints with stops in qpos, shape (k,)
    stops: Array  # Angles between which no stop acts [rad], shape (k, 2)
    body_parent: AnyArray
    body_dofs: AnyArray  # Number of degrees of freedom of each body
    cdof: Array
    passive: Array
    bias: Array
    applied: Array
    actuator: Array
    smooth: Array
    constraint: Array
    qacc: Array
    factor: Array
    """Factor L of the inertia matrix L' D L below the diagonal, as sparse rows.

    `inverse_diagonal` contains D^-1; `row_nonzeros` and `columns` describe the sparse rows.
    """
    inverse_diagonal: Array
    row_nonzeros: AnyArray
    columns: AnyArray
    wrenches: Array  # Working memory: wrench on each body with its descendants, shape (nbody, 6)
    work: Array  # Working memory for the solution, shape (3, nv)


class Views(NamedTuple):
    """Arrays of MjModel and MjData for the compiled loop, and indices into these arrays."""

    model: int
    data: int
    ctrl: Array
    act: Array
    torques: Array  # Torques of the actuators in the last step [N m], shape (2,)
    qpos: Array
    qvel: Array
    xpos: Array
    xmat: Array
    xipos: Array
    cvel: Array
    root_com: Array  # Centre of mass of the tractor, the reference point of `cvel`, shape (3,)
    implement_com: Array
    """Centre of mass of the implement with its wheels, or of the tractor without an implement, shape (3,)."""
    xfrc: Array
    cfrc_int: Array  # Wrench on each body from its parent, shape (nbody, 6)
    wheels: Index  # Body ids of the wheels, shape (4,)
    steer_q: int  # Index of the virtual steering angle in qpos
    spins_q: Index  # Indices of the driven rear wheels' angles in qpos, shape (2,)
    knuckles_q: Index  # Indices of the left and right knuckle angles in qpos, shape (2,)
    steer_v: int  # Index of the virtual steering rate in qvel
    spins_v: Index  # Indices of the driven rear wheels' rates in qvel, shape (2,)
    fronts_q: Index  # Indices of the front wheels' angles in qpos, shape (2,)
    fronts_v: Index  # Indices of the front wheels' rates in qvel, shape (2,)
    coupling: Coupling


def views_of(model: mujoco.MjModel, data: mujoco.MjData) -> Views:
    """Return the views of `model` and `data`, which must exist as long as the views are used."""
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
        cfrc_int=data.cfrc_int,
        wheels=np.array([model.body(f"wheel_{w}").id for w in WHEELS], dtype=np.int64),
        steer_q=int(model.joint("steer").qposadr[0]),
        spins_q=np.array([model.joint(f"spin_{w}").qposadr[0] for w in ("rl", "rr")], dtype=np.int64),
        knuckles_q=np.array([model.joint(f"steer_{w}").qposadr[0] for w in ("fl", "fr")], dtype=np.int64),
        steer_v=int(model.joint("steer").dofadr[0]),
        spins_v=np.array([model.joint(f"spin_{w}").dofadr[0] for w in ("rl", "rr")], dtype=np.int64),
        fronts_q=np.array([model.joint(f"spin_{w}").qposadr[0] for w in ("fl", "fr")], dtype=np.int64),
        fronts_v=np.array([model.joint(f"spin_{w}").dofadr[0] for w in ("fl", "fr")], dtype=np.int64),
        coupling=_coupling_of(model, data),
    )


def _coupling_of(model: mujoco.MjModel, data: mujoco.MjData) -> Coupling:
    rows = [model.equality(name).id for name in ("ackermann_fl", "ackermann_fr")]
    stopped = np.flatnonzero(model.jnt_limited)
    margins = model.jnt_margin[stopped]
    solimp = model.eq_solimp[rows]
    return Coupling(
        rows=np.array(rows if _is_plain(model) else [], dtype=np.int64),
        knuckles_v=np.array([model.joint(f"steer_{w}").dofadr[0] for w in ("fl", "fr")], dtype=np.int64),
        eq_active=data.eq_active,
        eq_data=model.eq_data,
        solref=np.array([_spring(model, row) for row in rows]),
        solimp=solimp,
        weights=model.dof_invweight0,
        frictionloss=model.dof_frictionloss,
        stops_q=model.jnt_qposadr[stopped].astype(np.int64),
        stops=model.jnt_range[stopped] + np.stack([margins, -margins], axis=1),
        body_parent=model.body_parentid,
        body_dofs=model.body_dofnum,
        cdof=data.cdof,
        passive=data.qfrc_passive,
        bias=data.qfrc_bias,
        applied=data.qfrc_applied,
        actuator=data.qfrc_actuator,
        smooth=data.qfrc_smooth,
        constraint=data.qfrc_constraint,
        qacc=data.qacc,
        factor=data.qLD,
        inverse_diagonal=data.qLDiagInv,
        row_nonzeros=model.M_rownnz,
        columns=model.M_colind,
        wrenches=np.zeros((model.nbody, 6)),
        work=np.zeros((3, model.nv)),
    )


def _is_plain(model: mujoco.MjModel) -> bool:
    """Return whether the knuckle couplings can be the only constraints in a step without contacts.

    The bodies must form one tree; no tendon, sensor, plugin or deformable part may add a constraint or read its force;
    the angles of the linkage must be zero in the initial position.
    """
    shifted = any(model.qpos0[model.joint(name).qposadr[0]] for name in ("steer", "steer_fl", "steer_fr"))
    hinged = np.isin(model.jnt_type[model.jnt_limited], (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE))
    tendons = model.tendon_limited.any() or model.tendon_frictionloss.any()
    others = model.nsensor or model.nplugin or model.nflex or tendons or model.opt.enableflags
    unusual = model.opt.disableflags & ~int(DISABLED)
    one_tree = (model.body_rootid[model.body_dofnum > 0] == CHASSIS).all()
    implicit = model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return bool(hinged.all() and one_tree and implicit and not (others or unusual or shifted))


def _spring(model: mujoco.MjModel, row: int) -> tuple[float, float]:
    """Return the stiffness and damping of an equality constraint, computed from `solref` and `solimp` as in MuJoCo."""
    (time, ratio), width = model.eq_solref[row], model.eq_solimp[row, 1]
    if time <= 0.0:
        return -time / width**2, -ratio / width
    time = max(time, 2.0 * model.opt.timestep)
    return 1.0 / (width * time * ratio) ** 2, 2.0 / (width * time)
