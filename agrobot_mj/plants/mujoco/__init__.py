"""The MuJoCo tractor: sole owner of MjModel and MjData."""

import mujoco

mujoco.set_mju_user_warning(lambda text: None)  # else it writes MUJOCO_LOG.TXT; `MujocoPlant.warnings` counts them
