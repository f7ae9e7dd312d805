"""The MuJoCo tractor: sole owner of MjModel and MjData."""
