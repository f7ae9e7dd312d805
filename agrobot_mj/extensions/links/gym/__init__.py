"""Gymnasium environment `agrobot_mj/FollowPath-v1`: a tractor follows a path. Requires the extra `gym`.

    >>> import gymnasium
    >>> import agrobot_mj.extensions.links.gym  # registers the environment
    >>> env = gymnasium.make("agrobot_mj/FollowPath-v1", scenario="side_slope", render_mode="rgb_array")

`gymnasium.make_vec` creates several environments (`env.FollowPathVector`). See docs/extensions/links/gym.md.
"""

try:
    import gymnasium
except ImportError:
    raise ImportError('agrobot_mj.extensions.links.gym needs gymnasium; pip install "agrobot-mj[gym]"') from None

ENV_ID = "agrobot_mj/FollowPath-v1"  # Name of the environment, for `gymnasium.make`


def register_env() -> None:
    """Register the environment with gymnasium. Called once when this module is imported."""
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(
            ENV_ID,
            entry_point="agrobot_mj.extensions.links.gym.env:FollowPath",
            vector_entry_point="agrobot_mj.extensions.links.gym.env:FollowPathVector",
        )


register_env()
