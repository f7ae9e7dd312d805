"""Conversion of `models/tractor.xml` and the scenario's parameters to a compiled MuJoCo model.

The XML file contains the structure of the tractor and default values; this module sets all values of the scenario
through `MjSpec`. Axle, knuckles and crank of the XML file are scaled with the tractor; wheel masses are parameters.
Chassis mass and inertia are computed so that the complete tractor has exactly the values of `TractorParameters`.
"""

from functools import cache
from math import degrees

import mujoco
import numpy as np

from agrobot_mj.core.resources import MODELS
from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.hydraulics import OilColumn
from agrobot_mj.machine.linkage import Linkage
from agrobot_mj.machine.tractor import COMPACT, AxleWheel, TractorParameters
from agrobot_mj.plants.mujoco.bodywork import dress, undress
from agrobot_mj.plants.mujoco.mechanism import in_unit_of
from agrobot_mj.plants.mujoco.own_body import own_spec
from agrobot_mj.plants.mujoco.own_contract import STEERS
from agrobot_mj.plants.mujoco.views import DISABLED
from agrobot_mj.terrain import Ground
from agrobot_mj.tyres.base import NativeContact

SPIN_GYRATION_2, DIAMETER_GYRATION_2 = 0.58, 0.32
"""Squared radius of gyration of a wheel divided by its squared radius [-], about the spin axis and about a diameter.
Assumed values, for a wheel with half of its mass in the tread."""


def ackermann_coefficients(tractor: TractorParameters) -> Array:
    """Return the coefficients (5,) of a quartic polynomial from the virtual steering angle to the left wheel angle
    [rad], with slope 1 at zero."""
    delta = np.linspace(-tractor.steer_limit, tractor.steer_limit, 501)
    t_2L = tractor.track_m / (2 * tractor.wheelbase_m)
    left = np.arctan2(np.tan(delta), 1 - t_2L * np.tan(delta))
    powers = np.stack([delta**2, delta**3, delta**4], axis=1)
    fitted = np.linalg.lstsq(powers, left - delta, rcond=None)[0]
    return np.concatenate([[0.0, 1.0], fitted])


STICKING = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""Solver impedance of dry friction in kingpins and brake. With MuJoCo's default, joints creep 1 deg within seconds."""
QUICK = (0.004, 1.0)
"""Time constant [s] and damping ratio [-] of the brake friction, chosen so that friction acts within one step."""
FACTORS = (1.0, 1.2, 1.5, 2.0, 3.0, 5.0)
"""Factors on typical inertias, tried in this order to propose inertias for a chassis whose inertias are physically
impossible [-]."""


def tractor_spec(machine: Machine) -> mujoco.MjSpec:
    """Return the `MjSpec` of a tractor without implement and ground. Raises ValueError for impossible parameters."""
    tractor, oil = machine.tractor, machine.cylinder.column(machine.tractor, machine.linkage)
    spec = _sized_spec(machine) if tractor.mjcf is None else _own(machine)
    _couple_knuckles(spec, tractor)
    _set_actuators(spec, tractor, oil, machine.driveline)
    steer = spec.joint("steer")
    steer.frictionloss = machine.linkage.friction_n_m
    if machine.linkage.friction_n_m > 0:
        steer.solimp_friction = STICKING
    spec.site("antenna").pos = tractor.antenna
    return spec


def _sized_spec(machine: Machine) -> mujoco.MjSpec:
    """Return the tractor of `models/tractor.xml` with the sizes and masses of a machine."""
    spec, tractor = _default().copy(), machine.tractor
    _size_front_axle(spec, tractor)
    _place_wheels(spec, tractor)
    if machine.linkage.moved:
        _lay_kingpins(spec, tractor, machine.linkage)
    spec.site("cg").pos = [tractor.cg_to_rear_axle, 0, tractor.cg_height_m]
    _complete_chassis(spec, spec.body("chassis"), tractor)
    dress(spec, tractor)
    return spec


@cache
def _default() -> mujoco.MjSpec:
    """Return the tractor of `models/tractor.xml` without visual geoms, as a template for copies.

    The result is cached, because MuJoCo needs more time to remove geoms than to compile the tractor.
    """
    spec = mujoco.MjSpec.from_file(str(MODELS / "tractor.xml"))
    undress(spec)
    return spec


def _own(machine: Machine) -> mujoco.MjSpec:
    """Return the tractor with a user-defined body. Raises ValueError if steering keys contradict the body."""
    if machine.linkage.moved:
        given = "kingpin_offset_m, kingpin_inclination_deg and caster_deg"
        raise ValueError(f"steering.linkage: the body of tractor.mjcf has its own kingpins; omit {given}")
    spec, tractor = own_spec(machine.tractor), machine.tractor
    sharpest = degrees(float(ackermann_coefficients(tractor) @ tractor.steer_limit ** np.arange(5)))
    for name in STEERS:
        joint = spec.joint(name)
        stops = np.asarray(joint.range) if joint.compiler.degree else np.degrees(joint.range)
        if stops[0] < stops[1] and np.abs(stops).min() < sharpest:
            raise ValueError(
                f"tractor.steer_limit_deg: a limit of {tractor.steer_limit_deg:g} deg turns the inner wheel by "
                f"{sharpest:.1f} deg, but the joint {name!r} of the body stops at {np.abs(stops).min():.1f} deg; widen "
                "the range of the joint, or reduce the limit"
            )
    return spec


def _size_front_axle(spec: mujoco.MjSpec, tractor: TractorParameters) -> None:
    """Scale the axle, knuckles and crank: masses with the tractor's mass, inertia and damping with mass times track^2.
    Without scaling, the stiff cylinder of a large machine would cause vibrations of a small crank."""
    mass = tractor.mass_kg / COMPACT.mass_kg
    moment = mass * (tractor.track_m / COMPACT.track_m) ** 2
    for name in ("front_axle", "crank", "knuckle_fl", "knuckle_fr"):
        body = spec.body(name)
        body.mass, body.inertia = mass * body.mass, moment * np.array(body.inertia)
    for name in ("axle_roll", "steer", "steer_fl", "steer_fr", *(f"spin_{wheel}" for wheel in WHEELS)):
        joint = spec.joint(name)
        joint.armature = moment * np.asarray(joint.armature)
        joint.damping = moment * np.asarray(joint.damping)


def _place_wheels(spec: mujoco.MjSpec, tractor: TractorParameters) -> None:
    half = tractor.track_m / 2
    front, rear = tractor.wheels
    spec.body("front_axle").pos = [tractor.wheelbase_m, 0, front.radius - front.deflection]
    roll = tractor.axle_pivot_limit_deg  # angle unit of the file
    spec.joint("axle_roll").range = [-roll, roll]
    spec.joint("axle_roll").pos = [0, 0, tractor.axle_pivot_radii * front.radius]
    for name, side in zip(WHEELS, (1, -1, 1, -1), strict=True):
        wheel = front if name[0] == "f" else rear
        body = spec.body(f"wheel_{name}")
        body.mass, body.inertia = wheel.mass, wheel_inertia(wheel)
        if wheel is front:
            spec.body(f"knuckle_{name}").pos = [0, side * half, 0]
        else:
            body.pos = [0, side * half, rear.radius - rear.deflection]
        spec.geom(f"tyre_{name}").size = [wheel.radius, wheel.width / 2, 0]


def wheel_inertia(wheel: AxleWheel) -> Array:
    """Return the moments of inertia of a wheel about its roll, spin and yaw axes [kg m2], shape (3,)."""
    inertia: Array = (
        wheel.mass * wheel.radius**2 * np.array([DIAMETER_GYRATION_2, SPIN_GYRATION_2, DIAMETER_GYRATION_2])
    )
    return inertia


def _couple_knuckles(spec: mujoco.MjSpec, tractor: TractorParameters) -> None:
    left, steer = ackermann_coefficients(tractor), spec.joint("steer")
    limit = in_unit_of(steer, tractor.steer_limit)
    steer.range = [-limit, limit]
    mirror = np.array([-1, 1, -1, 1, -1])
    for name, coefficients in (("ackermann_fl", left), ("ackermann_fr", mirror * left)):
        data = np.array(spec.equality(name).data)
        data[:5] = coefficients
        spec.equality(name).data = data


def _lay_kingpins(spec: mujoco.MjSpec, tractor: TractorParameters, linkage: Linkage) -> None:
    """Set the kingpin axes without moving the wheels at zero steering angle."""
    front = tractor.front_wheel
    for wheel, side in (("fl", 1), ("fr", -1)):
        joint, axis = spec.joint(f"steer_{wheel}"), np.array(linkage.axis(side))
        joint.axis = axis / np.linalg.norm(axis)
        joint.pos = linkage.foot(side, front.radius - front.deflection)


def _set_actuators(spec: mujoco.MjSpec, tractor: TractorParameters, oil: OilColumn, driveline: Driveline) -> None:
    limit, strength = tractor.steer_limit, driveline.strength(tractor)
    steering, drive = spec.actuator("steering"), spec.actuator("drive")
    for actuator, stiffness, damping, torque in (
        (steering, oil.stiffness, oil.damping, oil.relief_torque),
        (drive, strength.stiffness, strength.damping, strength.torque),
    ):
        actuator.gainprm[0] = stiffness
        actuator.biasprm[:3] = [0, -stiffness, -damping]
        actuator.forcerange = [-torque, torque]
        actuator.ctrlrange = [-1e3, 1e3]
    steering.actrange = [-limit, limit]
    for wheel in WHEELS:  # the plant sets the friction when the brake is applied
        spin = spec.joint(f"spin_{wheel}")
        spin.solimp_friction, spin.solref_friction = STICKING, QUICK
    _set_differentials(spec, tractor, driveline)


def _set_differentials(spec: mujoco.MjSpec, tractor: TractorParameters, driveline: Driveline) -> None:
    spec.equality("differential_lock").active = driveline.differential_lock
    front = spec.equality("front_wheel_drive")
    front.active = driveline.front_wheel_drive and driveline.front_engage_slip is None
    data = np.array(front.data)
    data[1] = driveline.front_lead * tractor.rear_wheel_radius_m / tractor.front_wheel_radius_m
    front.data = data
    if driveline.motor_front_share is not None:
        _add_motors(spec, tractor, driveline.motor_front_share)
    if not driveline.connected:
        drive = spec.actuator("drive")
        drive.gainprm[0], drive.biasprm[:3] = 0.0, [0, 0, 0]


def _add_motors(spec: mujoco.MjSpec, tractor: TractorParameters, share: float) -> None:
    """Connect the drive to one motor per wheel; both motors of an axle have the same torque."""
    gear = tractor.front_wheel_radius_m / tractor.rear_wheel_radius_m
    motors = spec.add_tendon(name="motors")
    for wheel in WHEELS:
        motors.wrap_joint(f"spin_{wheel}", 0.5 * (share * gear if wheel[0] == "f" else 1.0 - share))
    spec.actuator("drive").target = "motors"


def _complete_chassis(spec: mujoco.MjSpec, chassis: mujoco.MjsBody, tractor: TractorParameters) -> None:
    """Set mass, centre of mass and inertia of the chassis so that the complete tractor has the specified values."""
    cg = np.array([tractor.cg_to_rear_axle, 0, tractor.cg_height_m])
    whole = np.diag([tractor.roll_inertia_kg_m2, tractor.pitch_inertia_kg_m2, tractor.yaw_inertia_kg_m2])
    inertia = whole
    mass, moment = tractor.mass_kg, tractor.mass_kg * cg
    for body in spec.bodies:
        if body.name in ("world", "chassis"):
            continue
        position = _offset(body)
        mass -= body.mass
        moment = moment - body.mass * position
        inertia = inertia - np.diag(body.inertia) - steiner(body.mass, position - cg)
    if mass <= 0:
        raise ValueError(f"tractor.mass_kg: must be above the mass of wheels and axle, {tractor.mass_kg - mass:.0f} kg")
    centre = moment / mass
    inertia = inertia - steiner(mass, centre - cg)
    if not is_physical_inertia(inertia):
        principal = np.linalg.eigvalsh(inertia)
        raise ValueError(
            "tractor: roll_, pitch_ and yaw_inertia_kg_m2 give an impossible inertia of the chassis "
            f"(principal moments {np.round(principal, 1).tolist()} kg m2); {_fitting_inertia(tractor, whole - inertia)}"
        )
    chassis.mass, chassis.ipos, chassis.inertia = mass, centre, np.zeros(3)
    chassis.fullinertia = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]


def _fitting_inertia(tractor: TractorParameters, others: Array) -> str:
    """Return a text that proposes physically possible inertias; `others` (3, 3) is the inertia of all other bodies."""
    usual = TractorParameters(mass_kg=tractor.mass_kg, wheelbase_m=tractor.wheelbase_m)
    moments = np.array([usual.roll_inertia_kg_m2, usual.pitch_inertia_kg_m2, usual.yaw_inertia_kg_m2])
    fitting = (f * moments for f in FACTORS if is_physical_inertia(np.diag(f * moments) - others))
    if (found := next(fitting, None)) is None:
        return "increase them or reduce the mass of the wheels"
    return "set them to {:.4g}, {:.4g} and {:.4g} for this mass and wheelbase".format(*found)


def _offset(body: mujoco.MjsBody) -> Array:
    """Return the position of a body in the chassis frame [m] with joints at zero; its parents must have no rotation."""
    position = np.array(body.pos)
    while (body := body.parent).name != "chassis":
        position = position + body.pos
    return position


def steiner(mass: float, d: Array) -> Array:
    """Return the inertia about the origin [kg m2], shape (3, 3), of a point mass [kg] at the position `d` (3,) [m]."""
    return mass * (d @ d * np.eye(3) - np.outer(d, d))


def is_physical_inertia(inertia: Array) -> bool:
    """Return whether an inertia (3, 3) has positive principal moments, each at most the sum of the other two."""
    low, middle, high = np.linalg.eigvalsh(inertia)
    return bool(low > 0 and high <= low + middle)


def simulation_model(
    spec: mujoco.MjSpec, ground: Ground, physics_dt: float, native: NativeContact | None, drawn: bool = True
) -> mujoco.MjModel:
    """Return the compiled MuJoCo model of the tractor `spec` on its ground.

    If `native` is None, the wheels have no MuJoCo contact, and tyre laws support them. If `drawn` is false, visual
    geoms are omitted: MuJoCo would update a hundred lugs and panels in every step. Bodies have explicit masses, so that
    visual geoms do not affect the physics.
    """
    contact = native or NativeContact()
    spec.option.timestep = physics_dt
    spec.option.impratio = contact.impratio
    spec.option.disableflags |= DISABLED
    for wheel in WHEELS:
        tyre = spec.geom(f"tyre_{wheel}")
        tyre.contype = tyre.conaffinity = int(native is not None)
        tyre.friction[0] = contact.friction
        if native is not None:
            spec.add_sensor(
                name=f"contact_{wheel}",
                type=mujoco.mjtSensor.mjSENS_CONTACT,
                objtype=mujoco.mjtObj.mjOBJ_GEOM,
                objname=f"tyre_{wheel}",
                intprm=[2, 3, 1],
            )
    _add_ground(spec, ground)
    spec.compiler.discardvisual = not drawn
    return spec.compile()


def _add_ground(spec: mujoco.MjSpec, ground: Ground) -> None:
    x_min, x_max, y_min, y_max = ground.extent
    if ground.is_plane:
        h = ground.heights
        normal = np.array([h[0, 0] - h[0, 1], h[0, 0] - h[1, 0], ground.spacing])
        spec.worldbody.add_geom(
            name="ground",
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[x_max - x_min, y_max - y_min, 1],
            pos=[(x_min + x_max) / 2, (y_min + y_max) / 2, float(h.mean())],
            zaxis=normal / np.linalg.norm(normal),
        )
        return
    low, high = float(ground.heights.min()), float(ground.heights.max())
    rows, columns = ground.heights.shape
    span = max(high - low, 1e-3)
    spec.add_hfield(
        name="ground",
        nrow=rows,
        ncol=columns,
        size=[(x_max - x_min) / 2, (y_max - y_min) / 2, span, 1.0],
        userdata=((ground.heights - low) / span).ravel(),
    )
    spec.worldbody.add_geom(
        name="ground",
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname="ground",
        pos=[(x_min + x_max) / 2, (y_min + y_max) / 2, low],
    )
