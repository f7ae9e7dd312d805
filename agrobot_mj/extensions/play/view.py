"""View of the tractor and its ground in MuJoCo Studio. A separate model has the pose of the simulated tractor."""

from itertools import pairwise
from typing import Any

import mujoco
import numpy as np

from agrobot_mj.extensions.play.session import PlaySession
from agrobot_mj.plants.mujoco.implement import add_implement
from agrobot_mj.plants.mujoco.model import simulation_model, tractor_spec
from agrobot_mj.plants.mujoco.plant import MujocoPlant
from agrobot_mj.simulation.stepping import Simulation

PATH_PIECES, PATH_RADIUS_M, ABOVE_M = 150, 0.03, 0.03
"""Number of segments of the displayed path, radius of its line [m], and height of the line above the ground [m]."""
PATH_RGBA = (0.95, 0.75, 0.1, 1.0)
SKY = ((0.60, 0.80, 1.0), (0.75, 0.88, 1.0))
FIELD = ((0.36, 0.42, 0.22), (0.40, 0.46, 0.25))
SUN, HEADLIGHT = (0.6, 0.6, 0.6), (0.15, 0.15, 0.15)  # Colours of the lights. MuJoCo Studio adds light from the sky.
SQUARE_M = 4.0  # Period of the ground pattern [m]
CAMERA = (9.0, -18.0, 35.0)
"""Initial camera position: distance [m], elevation [deg], and azimuth relative to the heading of the tractor [deg]."""


class PlayView:
    """MuJoCo model and data for displaying an interactive drive."""

    def __init__(self, session: PlaySession) -> None:
        self.model = drawn_model(session.sim)
        self.data = mujoco.MjData(self.model)
        self.pose(session.sim)

    def pose(self, sim: Simulation) -> None:
        """Copy the pose and velocity of the simulated tractor to the view."""
        data = plant_of(sim).data
        self.data.qpos[:] = data.qpos
        self.data.qvel[:] = data.qvel
        self.data.time = data.time

    def aim(self, camera: Any) -> None:
        """Place a camera behind the tractor. The camera then follows the tractor."""
        w, x, y, z = self.data.qpos[3:7]
        yaw = np.degrees(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
        camera.type = int(mujoco.mjtCamera.mjCAMERA_TRACKING)
        camera.trackbodyid = self.model.body("chassis").id
        camera.distance, camera.elevation, camera.azimuth = CAMERA[0], CAMERA[1], yaw + CAMERA[2]
        camera.lookat[:] = self.data.qpos[:3]


def plant_of(sim: Simulation) -> MujocoPlant:
    """Return the MuJoCo plant of a simulation."""
    plant = sim.loop.plant
    assert isinstance(plant, MujocoPlant)
    return plant


def drawn_model(sim: Simulation) -> mujoco.MjModel:
    """Return a MuJoCo model of the tractor, its ground and its path for display, with contacts disabled."""
    plant, tyre = plant_of(sim), plant_of(sim).spec.tyre
    spec = tractor_spec(plant.machine)
    hitched = plant.machine.implement.hitched(plant.machine.tractor)
    if hitched is not None:
        add_implement(spec, hitched, plant.machine.tractor, tyre.native is not None)
    _dress(spec)
    _draw_path(spec, sim)
    simulation_model(spec, plant.ground, plant.model.opt.timestep, tyre.native)
    spec.geom("ground").material = "field"
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return spec.compile()


def _dress(spec: mujoco.MjSpec) -> None:
    """Add sky, lights and a ground pattern to a model specification."""
    builtin, kind = mujoco.mjtBuiltin, mujoco.mjtTexture
    for name, texture, pattern, colours, height in (
        ("sky", kind.mjTEXTURE_SKYBOX, builtin.mjBUILTIN_GRADIENT, SKY, 768),
        ("field", kind.mjTEXTURE_2D, builtin.mjBUILTIN_CHECKER, FIELD, 128),
    ):
        rgb = {"rgb1": colours[0], "rgb2": colours[1]}
        spec.add_texture(name=name, type=texture, builtin=pattern, width=128, height=height, **rgb)
    field = spec.add_material(name="field", texuniform=True, texrepeat=[1 / SQUARE_M, 1 / SQUARE_M])
    field.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "field"
    spec.worldbody.add_light(
        name="sun",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM,
        dir=[-0.3, 0.2, -1.0],
        pos=[0, 0, 4],
        diffuse=SUN,
    )
    spec.visual.headlight.diffuse = spec.visual.headlight.ambient = HEADLIGHT


def _draw_path(spec: mujoco.MjSpec, sim: Simulation) -> None:
    route, height, ground = sim.path, sim.loop.height, sim.loop.ground
    times = np.linspace(0.0, sim.scenario.path.turns_s[0][1], PATH_PIECES + 1)
    places = [route.at(t) for t in times.tolist()]
    points = [(r.x, r.y, height(ground, r.x, r.y)[0] + ABOVE_M) for r in places]
    for a, b in pairwise(points):
        if np.hypot(b[0] - a[0], b[1] - a[1]) > PATH_RADIUS_M / 10:
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[*a, *b],
                size=[PATH_RADIUS_M, 0, 0],
                rgba=PATH_RGBA,
                contype=0,
                conaffinity=0,
                group=1,
            )
