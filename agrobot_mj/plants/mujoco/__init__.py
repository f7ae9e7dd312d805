"""Plant with a MuJoCo model of the tractor. Outside this package, only extensions use MjModel and MjData."""

import mujoco

mujoco.set_mju_user_warning(lambda text: None)  # prevents MUJOCO_LOG.TXT; `MujocoPlant.warnings` counts warnings
