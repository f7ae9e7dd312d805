"""Requirements for a user-defined body (names, axes and positions), and an error message for each violation.

docs/bodies.md describes the requirements. Vectors are in the chassis frame with all joints at zero: x forward, y left,
z up, origin on the ground below the centre of the rear axle.
"""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from agrobot_mj.core.signals import WHEELS, Array
from agrobot_mj.machine.fitting import DEEPEST_SHARE

BODIES = ("chassis", *(f"wheel_{w}" for w in WHEELS))
SPINS = tuple(f"spin_{w}" for w in WHEELS)
STEERS = ("steer_fl", "steer_fr")
ROLL, CRANK = "axle_roll", "steer"
TYRES = tuple(f"tyre_{w}" for w in WHEELS)
OURS = (*SPINS, *STEERS, CRANK)  # Joints driven and coupled by the simulator
RESERVED = ("implement", "wheel_il", "wheel_ir")  # Names of bodies added by the simulator
ALONG, UPRIGHT = 0.999, 0.7  # Minimum cosines of axis errors [-]: 2.5 deg for wheels and axle, 45 deg for kingpins
PLACE_M, SHARE = 0.01, 0.05
"""Maximum position error [m], and maximum error of a wheel centre's height divided by the free radius [-]."""
ASIDE = 0.1  # Maximum distance of the centre of mass from the centre line, divided by the track width [-]
HINGE, FREE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_FREE)


class Posed:
    """User-defined body in its initial position: all joints at zero."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        mujoco.mj_kinematics(model, self.data)
        mujoco.mj_comPos(model, self.data)
        self.chassis = int(model.body("chassis").id)
        self.axes = self.data.xmat[self.chassis].reshape(3, 3)

    def place(self, point: Array) -> Array:
        """Convert a point (3,) from world coordinates to the chassis frame [m]."""
        found: Array = (point - self.data.xpos[self.chassis]) @ self.axes
        return found

    def direction(self, vector: Array) -> Array:
        """Convert a direction (3,) from world coordinates to the chassis frame."""
        found: Array = vector @ self.axes
        return found

    def centre(self, wheel: str) -> Array:
        """Return the centre of a wheel in the chassis frame [m], shape (3,)."""
        return self.place(self.data.xanchor[self.model.joint(f"spin_{wheel}").id])

    def size(self, wheel: str) -> tuple[float, float]:
        """Return the radius and the width of the tyre of a wheel [m]."""
        radius, half, _ = self.model.geom(f"tyre_{wheel}").size.tolist()
        return radius, 2 * half

    def above(self, body: int) -> tuple[int, ...]:
        """Return the ids of a body and its ancestors, up to the chassis or the world."""
        found = [body]
        while found[-1] not in (0, self.chassis):
            found.append(int(self.model.body_parentid[found[-1]]))
        return tuple(found)


class MassProperties(NamedTuple):
    """Mass properties of the complete machine, in the chassis frame."""

    mass: float  # Mass of the machine [kg]
    centre: Array  # Centre of mass of the machine [m], shape (3,)
    moments: Array  # Moments of inertia about the centre of mass: roll, pitch and yaw, shape (3,) [kg m2]


def inertial_of(posed: Posed) -> MassProperties:
    """Return the mass, centre of mass and inertia of the chassis with all attached bodies."""
    model, data = posed.model, posed.data
    com, total = data.subtree_com[posed.chassis], np.zeros((3, 3))
    for body in range(1, model.nbody):
        axes, d = data.ximat[body].reshape(3, 3), data.xipos[body] - com
        total += axes @ np.diag(model.body_inertia[body]) @ axes.T
        total += model.body_mass[body] * (d @ d * np.eye(3) - np.outer(d, d))
    moments = np.diag(posed.axes.T @ total @ posed.axes)
    return MassProperties(float(model.body_subtreemass[posed.chassis]), posed.place(com), moments)


def contract_faults(model: mujoco.MjModel) -> list[str]:
    """Return a message for each requirement that a compiled body violates."""
    found = [*_missing(model), *_more_wheels(model), *_beside(model)]
    if found:
        return found
    posed = Posed(model)
    found = [*_joints(posed), *_tyres(posed)]
    return found or [*_places(posed)]


def _has(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> bool:
    return bool(mujoco.mj_name2id(model, kind, name) >= 0)


def _missing(model: mujoco.MjModel) -> Iterator[str]:
    kinds = mujoco.mjtObj
    for what, kind, names in (
        ("body", kinds.mjOBJ_BODY, BODIES),
        ("joint", kinds.mjOBJ_JOINT, (*STEERS, *SPINS)),
        ("geom", kinds.mjOBJ_GEOM, TYRES),
    ):
        yield from (f"there is no {what} {name!r}; add it" for name in names if not _has(model, kind, name))
    for name in RESERVED:
        if _has(model, kinds.mjOBJ_BODY, name):
            yield f"body {name!r}: the simulator adds a part of this name; choose another name"


def _more_wheels(model: mujoco.MjModel) -> Iterator[str]:
    """Yield a message for each additional joint with unlimited rotation, such as a fifth wheel or a sprocket."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for i in range(model.njnt):
        name = model.joint(i).name
        endless = model.jnt_type[i] == HINGE and not model.jnt_limited[i] and model.jnt_stiffness[i] == 0.0
        if name not in (*OURS, ROLL) and endless and abs(data.xaxis[i, 2]) < UPRIGHT:
            body = model.body(model.jnt_bodyid[i]).name
            yield (
                f"joint {name!r} of body {body!r} rotates without limit like a wheel or a sprocket: only machines on "
                "four wheels are supported; remove the joint or limit its range"
            )


def _beside(model: mujoco.MjModel) -> Iterator[str]:
    for body in range(1, model.nbody):
        if model.body_parentid[body] == 0 and (name := model.body(body).name) != "chassis":
            yield f"body {name!r} is not attached to the chassis; remove it or attach it to the chassis"


def _joints(posed: Posed) -> Iterator[str]:
    model, data = posed.model, posed.data
    own = [i for i in range(model.njnt) if model.jnt_bodyid[i] == posed.chassis]
    if [int(model.jnt_type[i]) for i in own] != [FREE]:
        yield "body 'chassis' must have a <freejoint/> and no other joint"
    wanted = {**dict.fromkeys(SPINS, (1, ALONG)), **dict.fromkeys(STEERS, (2, UPRIGHT)), ROLL: (0, ALONG)}
    for i in range(model.njnt):
        name = model.joint(i).name
        if name in wanted:
            axis, cosine = wanted[name]
            if model.jnt_type[i] != HINGE or posed.direction(data.xaxis[i])[axis] < cosine:
                yield f"joint {name!r} must be a hinge whose axis points {('ahead', 'to the left', 'up')[axis]}"
        elif i not in own and name != CRANK and not model.jnt_stiffness[i] > 0.0:
            yield f"joint {name!r} moves freely; set its stiffness and damping, or remove it"
    for wheel in WHEELS:
        chain = posed.above(int(model.body(f"wheel_{wheel}").id))
        carried = {"spin": chain[:1], "steer": chain[:-1]} if wheel[0] == "f" else {"spin": chain[:1]}
        for joint, bodies in carried.items():
            if model.joint(f"{joint}_{wheel}").bodyid[0] not in bodies or chain[-1] != posed.chassis:
                yield f"joint '{joint}_{wheel}' must be between the chassis and the tyre of 'wheel_{wheel}'"


def _tyres(posed: Posed) -> Iterator[str]:
    model, data = posed.model, posed.data
    for wheel in WHEELS:
        geom = model.geom(f"tyre_{wheel}")
        axis = posed.direction(data.geom_xmat[geom.id].reshape(3, 3)[:, 2])
        off = posed.place(data.geom_xpos[geom.id]) - posed.centre(wheel)
        if geom.type[0] != mujoco.mjtGeom.mjGEOM_CYLINDER or abs(axis[1]) < ALONG:
            yield f"geom 'tyre_{wheel}' must be a cylinder on the axis of the wheel"
        elif model.body(geom.bodyid[0]).name != f"wheel_{wheel}" or np.abs(off).max() > PLACE_M:
            yield f"geom 'tyre_{wheel}' must be in the middle of 'wheel_{wheel}', on the axis of its joint"


def _places(posed: Posed) -> Iterator[str]:
    at = {wheel: posed.centre(wheel) for wheel in WHEELS}
    for left, right in (WHEELS[:2], WHEELS[2:]):
        if not at[left][1] > 0.0 > at[right][1] or np.abs(at[left] - at[right] * [1, -1, 1]).max() > PLACE_M:
            yield f"'wheel_{left}' and 'wheel_{right}' must be mirror images about the x axis of the chassis"
        if not np.allclose(posed.size(left), posed.size(right), rtol=1e-3):
            yield f"'tyre_{left}' and 'tyre_{right}' must have the same size"
    if abs(at["rl"][0]) > PLACE_M or not at["fl"][0] > 0.0:
        yield (
            "the origin of the chassis must be below the middle of the rear axle, with x towards the front axle: the "
            f"rear wheels are at x = {at['rl'][0]:.3f} m, the front ones at {at['fl'][0]:.3f} m"
        )
    for end in ("f", "r"):
        height, radius = at[f"{end}l"][2], posed.size(f"{end}l")[0]
        if not -DEEPEST_SHARE * radius <= height - radius <= SHARE * radius:
            yield (
                f"the origin of the chassis must be on the ground: 'wheel_{end}l' of radius {radius:.3f} m has its "
                f"centre {height:.3f} m above it"
            )
    aside, track = inertial_of(posed).centre[1], at["fl"][1] - at["fr"][1]
    if abs(aside) > ASIDE * track:
        yield f"the centre of mass is {aside:.2f} m off the middle; check the masses of the parts"
