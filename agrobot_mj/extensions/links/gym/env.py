"""`FollowPath`: environment in which one tractor follows the path of its scenario. A step is one tick of 50 ms.

Action, in [-1, 1]: steering angle divided by the steering limit, left positive. With `speed=True` the second component
is the speed, as the relative difference from the reference speed. Otherwise the speed is the reference speed plus a
proportional correction of the along-track error.

Reward, from the truth: progress / (1 + (cross-track / SHARP_M)^2) - EFFORT |change of the steering action|. The
progress of a tick is the path length covered for the first time divided by the path length covered by the reference, at
most 1. The reward per tick is 1 on the path at the reference speed, and 0 at standstill.

The episode terminates if the run fails (`rolled_over`, `stuck`, `diverged`, `left_terrain`), if the tractor is farther
than `max_offset_m` from the path (`off_path`), or if the reference is more than `max_lag_m` ahead along the path
(`lagging`). The episode is truncated at the end of the scenario (`completed` or `unfinished`).

`FollowPathVector` is the vector environment with several tractors in one process. The tractors are stepped in sequence,
because a tick is mostly Python code and threads give no speed-up. For several cores, use gymnasium's worker processes
(`vectorization_mode="async"`) or, better, one process per episode.
"""

from collections.abc import Mapping
from copy import deepcopy
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.random import Generator

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.interrupts import held_back
from agrobot_mj.core.signals import TICK_S, Array
from agrobot_mj.extensions.links.gym import observation
from agrobot_mj.extensions.links.gym.observation import Moment, Vector
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.stepping import Simulation

Range = tuple[float, float] | list[Any]
"""Range of a scenario value: bounds (low, high) of a uniform distribution, or list of equally probable values. With
integer bounds, values are integers."""
SEEDS = 2**31  # Number of possible seeds of an episode


def check_ranges(ranges: Mapping[str, Range]) -> None:
    """Raise `ScenarioError` if `ranges` contains an invalid range, an invalid list of values, or the key `seed`."""
    for key, values in ranges.items():
        if key == "seed":
            raise ScenarioError("randomise: seed: the seed differs in every episode; omit this key")
        pair = isinstance(values, tuple) and len(values) == 2 and all(isinstance(v, int | float) for v in values)
        if not (pair and values[0] <= values[1]) and not (isinstance(values, list) and values):
            raise ScenarioError(
                f"randomise: {key}: must be (low, high) for a range or a list of values to choose from, got {values!r}"
            )


def draw(ranges: Mapping[str, Range], generator: Generator) -> dict[str, Any]:
    """Return the scenario overrides for one episode: values sampled in the order of `ranges`, and the seed of the
    episode."""
    drawn: dict[str, Any] = {"seed": int(generator.integers(SEEDS))}
    for key, values in ranges.items():
        if isinstance(values, list):
            drawn[key] = values[int(generator.integers(len(values)))]
        elif all(isinstance(value, int) for value in values):
            drawn[key] = int(generator.integers(int(values[0]), int(values[1]), endpoint=True))
        else:
            drawn[key] = float(generator.uniform(*values))
    return drawn


SHARP_M = 0.2  # Cross-track error at which the reward is halved [m]. An error of 2 cm, the receiver noise, costs 1 %.
SLOWEST_M_S = 0.1  # Minimum reference speed for computing the progress [m/s], because the reference stops at cusps
EFFORT = 0.1  # Decrease of the reward if the steering action changes by 1 between two ticks [-]
CATCH_UP_PER_S = 0.5  # Gain from along-track error to speed correction without the action `speed` [1/s]. Assumed value.
MOST_CATCH_UP_M_S = 0.5  # Maximum speed correction [m/s]. Assumed value.
PREVIEW_M = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0)  # Default distances ahead at which the path curvature is observed [m]


DRAWN_M = np.arange(-5.0, 20.0, 0.25)  # Arc lengths of the drawn path points relative to the tractor [m]


class FollowPath(gymnasium.Env[Any, Any]):
    """Gymnasium environment in which one tractor follows the path of a scenario."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012 - as in gymnasium

    def __init__(
        self,
        scenario: str | Path = "figure_eight",
        plant: str | None = None,
        terrain: str | None = None,
        *,
        overrides: Mapping[str, Any] | None = None,
        randomise: Mapping[str, Range] | None = None,
        speed: bool = False,
        privileged: bool = False,
        preview_m: tuple[float, ...] = PREVIEW_M,
        max_offset_m: float = 3.0,
        max_lag_m: float = 10.0,
        render_mode: str | None = None,
        image_size: tuple[int, int] = (640, 480),
    ) -> None:
        """Create the environment for a scenario, given by name or path.

        `plant` and `terrain` are the values of `plant.kind` and `terrain.kind`. `overrides` contains scenario values,
        and `randomise` ranges from which each episode samples ((low, high) or a list of values), both by dotted key.
        `preview_m` contains the distances ahead at which the path curvature is observed [m]. `image_size` is the width
        and height of images [pixels]. Raises `ScenarioError` for invalid keys and values.
        """
        kinds = {"plant.kind": plant, "terrain.kind": terrain}
        given = {key: kind for key, kind in kinds.items() if kind is not None}
        self.scenario = load_scenario(scenario, {**given, **(overrides or {})})
        self.randomise = dict(randomise or {})
        check_ranges(self.randomise)
        # Each randomised key is applied once, so that an invalid key raises an error here and not in an episode.
        self.scenario.changed(draw(self.randomise, np.random.default_rng(0)))
        self.max_offset_m, self.max_lag_m = max_offset_m, max_lag_m
        self.render_mode, self.image_size = render_mode, image_size
        self._seen = tuple(preview_m), self.scenario.sensors.imu.enabled, privileged
        self.components, self._preview = observation.table(*self._seen), np.array(preview_m, dtype=float)
        self.highest = observation.bounds(self.components)
        self.observation_space = Box(-self.highest, self.highest, dtype=np.float32)
        self.speed, self.action_space = speed, Box(-1.0, 1.0, (2 if speed else 1,), dtype=np.float32)
        self.sim: Simulation | None = None
        self._camera: Any = None
        self._drawn: Simulation | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Vector, dict[str, Any]]:
        """Start a new episode. Without a seed, random values continue the sequence of previous episodes.
        `options={"overrides": {...}}` sets scenario keys, including `seed`, for this episode only."""
        with held_back():
            super().reset(seed=seed)
            drawn = draw(self.randomise, self.np_random)
            drawn |= (options or {}).get("overrides", {})
            sim = self.sim = Simulation(self.scenario, drawn)
            sim.reset()
            self._action, self._place = 0.0, 0.0
            self._moment = self._look(sim, 0.0)
            self._farthest = self._moment.beside_truth.s
            return self._observe(), self._info() | {"drawn": drawn}

    def step(self, action: Array) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Advance the simulation by one tick. Return observation, reward, terminated, truncated, and info with true
        values."""
        sim = self._running
        values = [float(value) for value in np.asarray(action, dtype=np.float64).ravel()]
        if len(values) != (wanted := 2 if self.speed else 1):
            raise TypeError(f"action: must have {wanted} numbers, got {len(values)}")
        if not all(map(isfinite, values)):
            raise ValueError(f"action: must be finite, got {action}")
        with held_back():
            turn = min(max(values[0], -1.0), 1.0)
            steer = turn * sim.scenario.tractor.steer_limit
            sim.step(steer=steer, speed=self._speed(values))
            self._moment = self._look(sim, steer)
            reward, self._action = self._reward(turn), turn
            info = self._info()
            truncated = info["outcome"] in ("completed", "unfinished")
            terminated = info["outcome"] != "" and not truncated
            if terminated or truncated:
                info["metrics"] = {k: v for k, v in sim.log().metrics.items() if isinstance(v, float)}
            return self._observe(), reward, terminated, truncated, info

    def __copy__(self) -> "FollowPath":
        return deepcopy(self)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of the environment without the renderer, for copies and pickles."""
        return vars(self) | {"components": (), "_camera": None, "_drawn": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.components = observation.table(*self._seen)

    def _reward(self, turn: float) -> float:
        beside = self._moment.beside_truth
        new = max(beside.s - self._farthest, 0.0)
        self._farthest = max(self._farthest, beside.s)
        due = TICK_S * max(abs(observation.reference_speed(self._moment)), SLOWEST_M_S)
        reward = min(new / due, 1.0) / (1.0 + (beside.offset / SHARP_M) ** 2) - EFFORT * abs(turn - self._action)
        return reward if isfinite(reward) else 0.0

    @property
    def _running(self) -> Simulation:
        if self.sim is None:
            raise RuntimeError("step and render need an episode; call reset() first")
        return self.sim

    def _speed(self, action: list[float]) -> float:
        reference = observation.reference_speed(self._moment)
        if len(action) > 1:
            return reference * (1.0 + min(max(action[1], -1.0), 1.0))
        more = CATCH_UP_PER_S * observation.along_track(self._moment)
        return reference + min(max(more, -MOST_CATCH_UP_M_S), MOST_CATCH_UP_M_S)

    def _look(self, sim: Simulation, steer: float) -> Moment:
        seen, t = sim.situation, sim.truth
        beside = sim.path.nearest(seen.estimate.x, seen.estimate.y, self._place, t.t)
        self._place = beside.s
        curvatures = sim.path.curvatures(beside.s + self._preview)
        return Moment(seen, t, beside, sim.path.nearest(t.x, t.y, beside.s, t.t), curvatures, steer)

    def _observe(self) -> Vector:
        return observation.observation(self.components, self.highest, self._moment)

    def _info(self) -> dict[str, Any]:
        sim, beside, t = self._running, self._moment.beside_truth, self._moment.truth.t
        lag, outcome = sim.path.distance_at(t) - beside.s, sim.outcome
        if not outcome and not abs(beside.offset) <= self.max_offset_m:
            outcome = "off_path"
        elif not outcome and lag > self.max_lag_m:
            outcome = "lagging"
        return {"t": t, "cross_track": beside.offset, "lag": lag, "outcome": outcome}

    def render(self) -> Any:
        """Return an image of the tractor on its path, uint8 (height, width, 3). Return None without a render mode."""
        if self.render_mode is None:
            return None
        sim = self._running
        if self._camera is None or self._drawn is not sim:
            from agrobot_mj.extensions.links.gym.camera import Camera

            self.close()
            s = sim.scenario
            self._camera, self._drawn = Camera(s.tractor, sim.loop.ground, self.image_size, s.implement), sim
        ahead = [sim.path.ahead(self._moment.beside.s + distance) for distance in DRAWN_M]
        path = [(p.x, p.y, sim.loop.height(sim.loop.ground, p.x, p.y)[0]) for p in ahead]
        return self._camera.picture(sim.loop.plant.configuration(), np.array(path))

    def close(self) -> None:
        """Release the resources of the renderer."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None


class FollowPathVector(SyncVectorEnv):
    """Vector environment with `num_envs` tractors. All other arguments are passed to `FollowPath`."""

    def __init__(
        self, num_envs: int = 1, *, autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP, **keywords: Any
    ) -> None:
        super().__init__([partial(FollowPath, **keywords)] * num_envs, autoreset_mode=autoreset_mode)

    def __copy__(self) -> "FollowPathVector":
        return deepcopy(self)

    def reset(self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start new episodes. `seed` is the seed of the first tractor, or a list with one seed per tractor. `options`
        has the same form as in `FollowPath.reset`."""
        with held_back():
            return super().reset(seed=seed, options=options)

    def step(self, actions: Any) -> Any:
        """Advance all tractors by one tick. Return observations, rewards, terminations, truncations and infos."""
        with held_back():
            return super().step(actions)
