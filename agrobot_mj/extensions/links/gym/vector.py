"""Many tractors in one process: `FollowPathVector`.

They step one after the other: a tick is mostly Python, in which threads take turns. Processes use several cores,
gymnasium's (`vectorization_mode="async"`) or, better, one for each episode.
"""

from copy import deepcopy
from functools import partial
from typing import Any

from gymnasium.vector import AutoresetMode, SyncVectorEnv

from agrobot_mj.core.interrupts import held_back
from agrobot_mj.extensions.links.gym.env import FollowPath


class FollowPathVector(SyncVectorEnv):
    """`num_envs` tractors; keywords as those of `FollowPath`. A signal interrupts between two ticks of all of them."""

    def __init__(
        self, num_envs: int = 1, *, autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP, **keywords: Any
    ) -> None:
        """Environments without an episode; `autoreset_mode` is gymnasium's."""
        super().__init__([partial(FollowPath, **keywords)] * num_envs, autoreset_mode=autoreset_mode)

    def __copy__(self) -> "FollowPathVector":
        """Return independent environments in the same states."""
        return deepcopy(self)

    def reset(self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None) -> Any:
        """New episodes; `seed` is that of the first tractor, or a list; `options` as those of `FollowPath.reset`."""
        with held_back():
            return super().reset(seed=seed, options=options)

    def step(self, actions: Any) -> Any:
        """One tick of all tractors."""
        with held_back():
            return super().step(actions)
