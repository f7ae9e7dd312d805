"""Images of the simulated tractor, rendered by MuJoCo with OpenGL.

The rendered scene is a separate MuJoCo model with tractor, ground, sky and light. The pose of the tractor in this model
is copied from the plant, which may be of any type.
"""

from itertools import pairwise

import mujoco
import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.machine import Machine
from agrobot_mj.machine.implements import ImplementBase, NoImplement
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.plants.mujoco.implement import add_implement
from agrobot_mj.plants.mujoco.model import simulation_model, tractor_spec
from agrobot_mj.plants.mujoco.views import CHASSIS
from agrobot_mj.terrain import Ground

NONE = NoImplement()
Picture = np.ndarray[tuple[int, ...], np.dtype[np.uint8]]
PATH_WIDTH_M, PATH_RGBA = 0.04, np.array([0.95, 0.55, 0.10, 1.0], dtype=np.float32)
"""Half width [m] and colour of the path in rendered images."""
DISTANCE_M, ELEVATION_DEG, AZIMUTH_DEG = 9.0, -25.0, 130.0
"""Camera position for the default tractor: distance [m], elevation [deg] and azimuth [deg]."""


class NoDisplayError(RuntimeError):
    """Exception for a computer without OpenGL support for MuJoCo."""


class Camera:
    """Renderer for images of one tractor on its terrain."""

    def __init__(
        self, tractor: TractorParameters, ground: Ground, size: tuple[int, int], implement: ImplementBase = NONE
    ) -> None:
        spec = tractor_spec(Machine(tractor))
        if (hitched := implement.hitched(tractor)) is not None:
            add_implement(spec, hitched, tractor, native=False)
        spec.visual.global_.offwidth, spec.visual.global_.offheight = size
        _light(spec)
        self.model = simulation_model(spec, ground, 0.002, None)
        self.model.geom_matid[self.model.geom("ground").id] = self.model.material("field").id
        self.data = mujoco.MjData(self.model)
        self.view = mujoco.MjvCamera()
        self.view.type, self.view.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, CHASSIS
        self.view.elevation, self.view.azimuth = ELEVATION_DEG, AZIMUTH_DEG
        self.view.distance = tractor.size * DISTANCE_M
        try:
            self.renderer = mujoco.Renderer(self.model, height=size[1], width=size[0])
        except Exception as error:  # the type of exception depends on the OpenGL library
            raise NoDisplayError(
                f"MuJoCo cannot find an OpenGL library for rendering ({error}); set MUJOCO_GL=egl or MUJOCO_GL=osmesa "
                "in the environment before Python starts"
            ) from None

    def picture(self, configuration: Array, path: Array) -> Picture:
        """Return an image (height, width, 3) of the tractor and a path (n, 3) [m]. `configuration` is the MuJoCo vector
        `qpos`."""
        self.data.qpos[:] = configuration
        mujoco.mj_forward(self.model, self.data)
        self.renderer.update_scene(self.data, self.view)
        for start, end in pairwise(path + np.array((0.0, 0.0, PATH_WIDTH_M))):
            self._strip(start, end)
        return np.asarray(self.renderer.render(), dtype=np.uint8)

    def _strip(self, start: Array, end: Array) -> None:
        """Add a path segment between two points (3,) [m] to the scene, unless the scene is full."""
        scene = self.renderer.scene
        if scene.ngeom >= scene.maxgeom:
            return
        geom, kind = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_CAPSULE
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), PATH_RGBA)
        mujoco.mjv_connector(geom, kind, PATH_WIDTH_M, start, end)
        scene.ngeom += 1

    def close(self) -> None:
        """Release the resources of the renderer."""
        self.renderer.close()


def _light(spec: mujoco.MjSpec) -> None:
    spec.visual.map.zfar = 40.0
    kinds, patterns = mujoco.mjtTexture, mujoco.mjtBuiltin
    for name, kind, pattern, first, second in (
        ("sky", kinds.mjTEXTURE_SKYBOX, patterns.mjBUILTIN_GRADIENT, [0.75, 0.85, 0.95], [0.35, 0.50, 0.70]),
        ("field", kinds.mjTEXTURE_2D, patterns.mjBUILTIN_CHECKER, [0.54, 0.60, 0.34], [0.60, 0.66, 0.38]),
    ):
        spec.add_texture(name=name, type=kind, builtin=pattern, rgb1=first, rgb2=second, width=256, height=256)
    field = spec.add_material(name="field", texuniform=True, texrepeat=[0.5, 0.5])
    field.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "field"
    sun = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    spec.worldbody.add_light(name="sun", type=sun, pos=[0, 0, 20], dir=[0.3, 0.2, -1], castshadow=False)
