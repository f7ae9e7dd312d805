"""Many tractors at once, on threads: `FollowPathVector`.

The physics of a tick runs compiled and without Python's global lock, so that it overlaps on several cores while the
stages in Python take turns. Each tractor has a simulation of its own; results equal those of gymnasium's serial
`SyncVectorEnv` to the last bit.
"""

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import iterate

from agrobot_mj.links.gym.env import FollowPath


class Begun(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose `step` or `reset` runs on a thread; the next call returns the result."""

    future: Future[Any] | None = None

    def begin(self, pool: ThreadPoolExecutor, call: Callable[..., Any], *arguments: Any, **named: Any) -> None:
        """Begin a call of the environment's own."""
        self.future = pool.submit(call, *arguments, **named)

    def _result(self) -> Any:
        future, self.future = self.future, None
        return future.result() if future else None

    def step(self, action: Any) -> Any:
        """Result of the step under way, or of one done now."""
        return self._result() or self.env.step(action)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Result of the reset under way, or of one done now."""
        return self._result() or self.env.reset(seed=seed, options=options)


def _itself(env: Begun) -> Begun:
    return env


class FollowPathVector(SyncVectorEnv):
    """`num_envs` tractors; keywords as those of `FollowPath`."""

    def __init__(
        self,
        num_envs: int = 1,
        *,
        threads: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        **keywords: Any,
    ) -> None:
        """On so many `threads`, as many as there are cores if left out."""
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
        self.pool = ThreadPoolExecutor(min(num_envs, threads or cores or 1))
        self.begun = [Begun(FollowPath(**keywords)) for _ in range(num_envs)]
        super().__init__([partial(_itself, env) for env in self.begun], autoreset_mode=autoreset_mode)

    def reset(self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None) -> Any:
        """New episodes; `seed` is that of the first tractor, or a list; `options` as those of `FollowPath.reset`."""
        if isinstance(seed, int):
            seed = [seed + k for k in range(self.num_envs)]
        seeds = seed if seed is not None else [None] * self.num_envs
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool))
        inner = {key: value for key, value in (options or {}).items() if key != "reset_mask"} or None
        if len(seeds) == self.num_envs == len(mask):
            for env, one, wanted in zip(self.begun, seeds, mask, strict=True):
                if wanted:
                    env.begin(self.pool, env.env.reset, seed=one, options=inner)
        return super().reset(seed=seed, options=options)

    def step(self, actions: Any) -> Any:
        """One tick of all tractors."""
        again = self._autoreset_envs & (self.autoreset_mode == AutoresetMode.NEXT_STEP)
        for env, action, ended in zip(self.begun, iterate(self.action_space, actions), again, strict=True):
            if ended:
                env.begin(self.pool, env.env.reset)
            else:
                env.begin(self.pool, env.env.step, action)
        return super().step(actions)

    def close_extras(self, **keywords: Any) -> None:
        """End the threads and close the environments."""
        self.pool.shutdown(cancel_futures=True)
        super().close_extras(**keywords)
