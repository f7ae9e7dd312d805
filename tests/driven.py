"""Simulation of a few ticks on both plants. A process that imports this module has loaded the kernels."""

from agrobot_mj import load_scenario, run

for plant in ("bicycle", "mujoco"):
    run(load_scenario("straight_line", {"duration_s": 0.1, "plant.kind": plant}))
