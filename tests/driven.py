"""Simulation of a few ticks on both plants, which loads the kernels when this module is imported."""

from agrobot_mj import load_scenario, run

for plant in ("bicycle", "mujoco"):
    run(load_scenario("straight_line", {"duration_s": 0.1, "plant.kind": plant}))
