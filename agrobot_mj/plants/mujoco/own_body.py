"""User-defined body (`tractor.mjcf`): derivation of parameters of the table `[tractor]`, and model for the simulation.

The masses, joints, springs and visual geoms of the file are kept. Its actuators, sensors, keyframes and couplings of
wheel and knuckle joints are removed, because the simulator provides steering, drive and tyres.
"""

from functools import lru_cache
from itertools import product
from math import nan
from typing import Any

import mujoco
import numpy as np
from pydantic import ValidationError

from agrobot_mj.core.messages import fault
from agrobot_mj.core.resources import MODELS, Stamp, stamp
from agrobot_mj.core.signals import WHEELS
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.mujoco.bodywork import HIDDEN, draw, parts, touching, wheel
from agrobot_mj.plants.mujoco.mechanism import add_mechanism
from agrobot_mj.plants.mujoco.own_contract import OURS, ROLL, TYRES, Posed, contract_faults, inertial_of
from agrobot_mj.plants.mujoco.own_files import own_files

CONTACT = "_contact"  # Suffix of the names of geoms that touch the ground
PLAIN = {
    "geom": (
        *("contype", "conaffinity", "condim", "priority", "friction", "solref", "solimp", "solmix", "margin", "gap"),
        *("group", "mass", "density", "rgba", "material"),
    ),
    "joint": (
        *("armature", "damping", "stiffness", "frictionloss", "limited", "range", "ref", "springref", "margin", "pos"),
        *("axis", "solref_limit", "solimp_limit", "solref_friction", "solimp_friction", "actfrclimited"),
    ),
    "equality": ("solref", "solimp"),
    "tendon": ("limited", "range", "stiffness", "damping", "frictionloss", "armature", "springlength", "actfrclimited"),
    "actuator": ("gear", "delay", "nsample", "armature", "damping", "actearly", "inheritrange", "group"),
}
"""Attributes of each element that `_forget_defaults` resets, because the default class of a file may change them."""
DIGITS = 10  # Number of significant digits of values derived from a body


def measures(name: str, springs: dict[str, float]) -> dict[str, float]:
    """Return the parameters of `[tractor]` that follow from the body in the file `name` and the tyre stiffness
    `springs`."""
    files = own_files(name)
    return dict(_measure(str(files.main), tuple(stamp(str(f)) for f in (files.main, *files.others)), *springs.items()))


@lru_cache(maxsize=32)
def _measure(name: str, _stamps: tuple[Stamp | None, ...], *springs: tuple[str, float]) -> dict[str, float]:
    _, model = _load_body(name)
    posed = Posed(model)
    whole, short = inertial_of(posed), name.rpartition("/")[2]
    front, rear = posed.centre("fl"), posed.centre("rl")
    found = {
        "wheelbase_m": front[0] - rear[0],
        "track_m": 2 * front[1],
        "mass_kg": whole.mass,
        "front_load_fraction": (whole.centre[0] - rear[0]) / (front[0] - rear[0]),
        **dict(zip(("roll_inertia_kg_m2", "pitch_inertia_kg_m2", "yaw_inertia_kg_m2"), whole.moments, strict=True)),
    }
    for end, w in (("front", "fl"), ("rear", "rl")):
        found[f"{end}_wheel_radius_m"], found[f"{end}_wheel_width_m"] = posed.size(w)
        found[f"{end}_wheel_mass_kg"] = float(model.body(f"wheel_{w}").mass[0])
    roll = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, ROLL)
    if roll >= 0 and model.jnt_limited[roll]:
        found["axle_pivot_limit_deg"] = float(np.degrees(np.abs(model.jnt_range[roll]).min()))
    found = {key: float(f"{value:.{DIGITS}g}") for key, value in found.items()}
    at_rest = _validate_parameters(short, found, dict(springs)).rear_wheel
    found["cg_height_m"] = float(f"{whole.centre[2] - (rear[2] - at_rest.radius + at_rest.deflection):.{DIGITS}g}")
    _validate_parameters(short, found, dict(springs))
    return found


def _validate_parameters(short: str, found: dict[str, float], springs: dict[str, float]) -> TractorParameters:
    try:
        return TractorParameters.model_validate(found | springs)
    except ValidationError as error:
        lines = [
            f"the body gives {'.'.join(map(str, e['loc']))}, which {fault(e)}"
            for e in map(dict[str, Any], error.errors())
        ]
        raise ValueError("\n".join(f"{short}: {line}" for line in lines)) from None


def _load_body(name: str) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    main = own_files(name).main
    try:
        spec = mujoco.MjSpec.from_file(str(main))
        spec.compiler.fusestatic = spec.compiler.discardvisual = False
        model = spec.compile()
    except Exception as error:  # MuJoCo raises various exceptions
        raise ValueError(f"{main.name}: MuJoCo cannot read the file: {' '.join(str(error).split())}") from None
    if faults := contract_faults(model):
        raise ValueError("\n".join(f"{main.name}: {line}" for line in faults))
    return spec, model


def own_spec(tractor: TractorParameters) -> mujoco.MjSpec:
    """Return the `MjSpec` of a user-defined body with steering and drive. Raises ValueError for an invalid body."""
    spec, model = _load_body(tractor.mjcf or "")
    default = mujoco.MjSpec.from_file(str(MODELS / "tractor.xml"))
    _keep_masses(spec, model)
    _leave_out(spec, model)
    _forget_defaults(spec)
    spec.option = default.option
    for material in default.materials:
        if spec.material(material.name) is None:
            spec.add_material(name=material.name, rgba=material.rgba, specular=material.specular)
    _sort_geoms(spec, tractor)
    add_mechanism(spec, spec.body(model.body(model.body_parentid[model.joint("steer_fl").bodyid[0]]).name), tractor)
    centre = inertial_of(Posed(model)).centre
    for name in ("cg", "antenna"):
        if (site := spec.site(name)) is not None:
            spec.delete(site)
        spec.body("chassis").add_site(name=name, group=HIDDEN)
    spec.site("cg").pos = [centre[0], 0.0, centre[2]]
    return spec


def _forget_defaults(spec: mujoco.MjSpec) -> None:
    """Reset the default class so that added elements get MuJoCo's defaults; existing elements keep their values."""
    plain = mujoco.MjSpec().default
    for kind, keys in PLAIN.items():
        ours, theirs = getattr(plain, kind), getattr(spec.default, kind)
        for key in keys:
            setattr(theirs, key, getattr(ours, key))
    for body in spec.bodies[1:]:
        body.childclass = "main"


def _keep_masses(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Write the masses that MuJoCo computes from geoms to the bodies, because visual geoms are removed for the
    simulation."""
    always = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    for body in spec.bodies[1:]:
        body.gravcomp = 0.0
        if (always or not body.explicitinertial) and model.body_mass[body.id] > 0.0:
            body.mass, body.ipos, body.iquat = (
                a[body.id] for a in (model.body_mass, model.body_ipos, model.body_iquat)
            )
            body.inertia, body.fullinertia = model.body_inertia[body.id], [nan, 0, 0, 0, 0, 0]
            body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
            body.explicitinertial = True
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO


def _leave_out(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Remove elements that the simulator provides: actuators, sensors, wheel and knuckle couplings, and ground."""
    for element in [*spec.actuators, *spec.sensors, *spec.keys, *spec.pairs, *spec.lights, *spec.cameras]:
        spec.delete(element)
    for geom in list(spec.worldbody.geoms):
        spec.delete(geom)
    ours = {int(model.joint(name).id) for name in OURS if spec.joint(name) is not None}
    tendons = {model.tendon(i).name for i in range(model.ntendon) if ours & _joints_of(model, i)}
    for equality in list(spec.equalities):
        if {equality.name1, equality.name2} & (tendons | set(OURS)):
            spec.delete(equality)
    for tendon in list(spec.tendons):
        if tendon.name in tendons:
            spec.delete(tendon)


def _joints_of(model: mujoco.MjModel, tendon: int) -> set[int]:
    first = int(model.tendon_adr[tendon])
    wraps = range(first, first + int(model.tendon_num[tendon]))
    return {int(model.wrap_objid[w]) for w in wraps if model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT}


def _sort_geoms(spec: mujoco.MjSpec, tractor: TractorParameters) -> None:
    """Classify geoms as tyre, contact or visual geoms; add default contact and visual geoms where the body has none."""
    drawn, touching_bodies = set[str](), set[str]()
    for geom in spec.geoms:
        touches, tyre = geom.name.endswith(CONTACT), geom.name in TYRES
        geom.contype, geom.conaffinity = 0, int(touches)
        if tyre:
            geom.condim, geom.priority, geom.group, geom.solref = 3, 1, 1, [0.02, 1.0]
            geom.material = geom.material or "rubber"
        elif touches:
            geom.group = HIDDEN
            touching_bodies.add(geom.parent.name)
        elif geom.group < HIDDEN:
            drawn.add(geom.parent.name)
    wheels = {f"wheel_{w}" for w in WHEELS}
    for w, size in zip(WHEELS, 2 * [tractor.front_wheel] + 2 * [tractor.rear_wheel], strict=True):
        if f"wheel_{w}" not in drawn:
            for part in wheel(w, size.radius, size.width):
                draw(spec.body(f"wheel_{w}"), part)
    if not drawn - wheels:
        for part in parts(tractor):
            draw(spec.body("chassis"), part)
    if not touching_bodies:
        touching_bodies.add("chassis")
        for part in touching(tractor):
            draw(spec.body("chassis"), part, group=HIDDEN, conaffinity=1)
    for body, wheel_body in product(sorted(touching_bodies), sorted(wheels)):
        spec.add_exclude(bodyname1=body, bodyname2=wheel_body)
