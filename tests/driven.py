"""Drives both plants for a moment, so that a process which has imported this has the kernels at hand."""

from agrobot_mj import load_scenario, run

for plant in ("bicycle", "mujoco"):
    run(load_scenario("straight_line", {"duration_s": 0.1, "plant.kind": plant}))
