"""Vector environment with several tractors in one process: `FollowPathVector`.

The tractors are stepped in sequence: a tick is mostly Python code, so threads give no speed-up. To use several cores,
choose gymnasium's processes (`vectorization_mode="async"`) or, better, one process per episode.
"""

from copy import deepcopy
from functools import partial
from typing import Any

from gymnasium.vector import AutoresetMode, SyncVectorEnv

from agrobot_mj.core.interrupts import held_back
from agrobot_mj.extensions.links.gym.env import FollowPath


class FollowPathVector(SyncVectorEnv):
    """Vector environment of `num_envs` tractors; keywords as in `FollowPath`. Signals interrupt only between ticks."""

    def __init__(
        self, num_envs: int = 1, *, autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP, **keywords: Any
    ) -> None:
        super().__init__([partial(FollowPath, **keywords)] * num_envs, autoreset_mode=autoreset_mode)

    def __copy__(self) -> "FollowPathVector":
        return deepcopy(self)

    def reset(self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start new episodes. `seed` is that of the first tractor, or a list; `options` as in `FollowPath.reset`."""
        with held_back():
            return super().reset(seed=seed, options=options)

    def step(self, actions: Any) -> Any:
        """Advance all tractors by one tick."""
        with held_back():
            return super().step(actions)
