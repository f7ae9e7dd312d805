"""Steering and drive mechanism, added to a user-defined body that has wheels and steering knuckles.

The mechanism is the same as in `models/tractor.xml`: the crank of the virtual front wheel, its coupling to both
knuckles, the differentials and both actuators. The module `model` sets the parameters that depend on the scenario.
"""

from math import degrees

import mujoco

from agrobot_mj.machine.tractor import COMPACT, TractorParameters

CRANK_KG, CRANK_ARMATURE, CRANK_DAMPING = 1e-6, 1.0, 5.0
"""Mass of the crank [kg], which is part of the mass of the body; inertia [kg m2] and damping [N m s/rad] of the parts
that move with the steering cylinder of the compact tractor. Inertia and damping scale with mass times squared track
width."""
STIFF = (0.004, 1.0)  # Time constant [s] and damping ratio of the coupling between crank and knuckles
LIMITED = mujoco.mjtLimited.mjLIMITED_TRUE


def in_unit_of(element: mujoco.MjsBody | mujoco.MjsJoint, angle: float) -> float:
    """Convert an angle [rad] to the angle unit of the MJCF file that contains `element`."""
    return degrees(angle) if element.compiler.degree else angle


def add_mechanism(spec: mujoco.MjSpec, carrier: mujoco.MjsBody, tractor: TractorParameters) -> None:
    """Add the steering and the drive to the model `spec`; the front knuckles are attached to the body `carrier`."""
    if spec.joint("steer") is None:
        _add_crank(carrier, tractor)
    for name, knuckle in (("ackermann_fl", "steer_fl"), ("ackermann_fr", "steer_fr")):
        spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_JOINT, name1=knuckle, name2="steer", solref=STIFF)
    for name, ends in (("differential", ("spin_rl", "spin_rr")), ("front_differential", ("spin_fl", "spin_fr"))):
        tendon = spec.add_tendon(name=name)
        for end in ends:
            tendon.wrap_joint(end, 0.5)
    lock, tied = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtEq.mjEQ_TENDON
    straight = [0.0, 1.0, *10 * [0.0]]
    spec.add_equality(
        name="differential_lock", type=lock, name1="spin_rl", name2="spin_rr", data=straight, active=False
    )
    front = {"name1": "front_differential", "name2": "differential"}
    spec.add_equality(name="front_wheel_drive", type=tied, data=straight, active=False, **front)
    joint, tendon = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_TENDON
    for name, kind, target in (("steering", joint, "steer"), ("drive", tendon, "differential")):
        actuator = spec.add_actuator(name=name, trntype=kind, target=target)
        actuator.set_to_intvelocity(kp=1.0)
        actuator.actlimited = actuator.ctrllimited = actuator.forcelimited = LIMITED
        actuator.actrange = [-1e6, 1e6]


def _add_crank(carrier: mujoco.MjsBody, tractor: TractorParameters) -> None:
    share = tractor.mass_kg / COMPACT.mass_kg * (tractor.track_m / COMPACT.track_m) ** 2
    crank = carrier.add_body(name="crank")
    crank.explicitinertial = True
    crank.mass, crank.inertia = CRANK_KG, 3 * [CRANK_KG]
    joint = crank.add_joint(name="steer", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], limited=LIMITED)
    joint.armature, joint.damping = share * CRANK_ARMATURE, [share * CRANK_DAMPING, 0.0, 0.0]
