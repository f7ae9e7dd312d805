"""Gymnasium environment: interface, observations, seeds, ends of episodes, vector environments, and images."""

import copy
import os
import pickle
import signal
import subprocess
import sys
import warnings
from math import atan2, hypot
from pathlib import Path

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="needs gymnasium; pip install agrobot-mj[gym]")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode, SyncVectorEnv  # noqa: E402

from agrobot_mj import Simulation  # noqa: E402
from agrobot_mj.core.errors import ScenarioError  # noqa: E402
from agrobot_mj.extensions.links.gym import ENV_ID  # noqa: E402
from agrobot_mj.extensions.links.gym.env import FollowPath, FollowPathVector  # noqa: E402
from agrobot_mj.plants import BicyclePlant  # noqa: E402

ROOT = Path(__file__).parents[3]
SHORT = {"duration_s": 2.0}
FAST = {"plant": "bicycle", "overrides": SHORT}
VARIED = {
    "scenario": "circle",
    "overrides": {"duration_s": 1.5, "plant.settle_s": 0.5},
    "randomise": {"tractor.mass_kg": (650, 850), "steering.valve.dead_band_v": (0.2, 0.7), "path.radius_m": [8, 10]},
}


def python(code, **environment):
    """Run code in a separate Python process, in which libraries and environment can differ."""
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    surroundings = {**os.environ, "PYTHONPATH": path, **environment}
    return subprocess.run([sys.executable, "-c", code], env=surroundings, capture_output=True, text=True, check=False)


def actions(env, count, seed=7):
    env.action_space.seed(seed)
    return [env.action_space.sample() for _ in range(count)]


def episode(env, seed, **options):
    """Return the reset result and all step results of an episode with random actions."""
    observed, info = env.reset(seed=seed, **options)
    found = [(observed, 0.0, False, False, info)]
    for action in actions(env, 100):
        found.append(env.step(action))
        if found[-1][2] or found[-1][3]:
            break
    return found


@pytest.mark.parametrize(
    "keywords",
    [
        FAST,
        {"scenario": "side_slope", "overrides": SHORT, "speed": True, "privileged": True},
        {"scenario": "circle", "terrain": "bumps", "overrides": {**SHORT, "sensors.imu.enabled": True}},
        VARIED,
    ],
    ids=["bicycle", "slope", "bumps", "varied"],
)
def test_gymnasium_env_checker_passes_without_a_warning(keywords):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(ENV_ID, **keywords).unwrapped, skip_render_check=True)


def test_equal_seeds_give_equal_episodes_and_different_seeds_do_not():
    env = FollowPath(**VARIED)
    first, again, other = (episode(env, seed) for seed in (3, 3, 4))
    assert len(first) == 31
    for (o, r, *ends, i), (o2, r2, *ends2, i2) in zip(first, again, strict=True):
        assert (o.tobytes(), r, ends) == (o2.tobytes(), r2, ends2)
        assert {**i, "metrics": 0} == {**i2, "metrics": 0}
    assert first[0][4]["drawn"] != other[0][4]["drawn"]
    assert any(a[0].tobytes() != b[0].tobytes() for a, b in zip(first, other, strict=True))


def test_reset_without_a_seed_continues_the_random_sequence():
    env = FollowPath(**VARIED)
    env.reset(seed=1)
    drawn = [env.reset()[1]["drawn"] for _ in range(3)]
    assert len({one["seed"] for one in drawn}) == 3


def test_randomised_parameters_stay_in_range_and_are_applied():
    env = FollowPath(**VARIED)
    radii = set()
    for seed in range(6):
        _, info = env.reset(seed=seed)
        drawn = info["drawn"]
        assert isinstance(drawn["tractor.mass_kg"], int)
        assert 650 <= drawn["tractor.mass_kg"] <= 850
        assert 0.2 <= drawn["steering.valve.dead_band_v"] <= 0.7
        assert env.sim.scenario.tractor.mass_kg == drawn["tractor.mass_kg"]
        assert env.sim.scenario.steering.valve.dead_band_v == drawn["steering.valve.dead_band_v"]
        radii.add(drawn["path.radius_m"])
    assert radii == {8, 10}


def test_reset_options_override_keys_for_one_episode():
    env = FollowPath(**FAST)
    env.reset(seed=1, options={"overrides": {"seed": 42, "duration_s": 1.0}})
    assert (env.sim.scenario.seed, env.sim.scenario.ticks) == (42, 20)
    env.reset()
    assert env.sim.scenario.ticks == 40


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"scenario": "circel"}, "did you mean 'circle'"),
        ({"randomise": {"tractor.mas_kg": (1, 2)}}, r"tractor\.mas_kg: unknown key"),
        ({"randomise": {"tractor.mass_kg": (2, 1)}}, r"tractor\.mass_kg: must be \(low, high\)"),
        ({"randomise": {"path.radius_m": []}}, r"path\.radius_m: must be \(low, high\) for a range or a list"),
        ({"randomise": {"seed": (1, 2)}}, "seed: the seed differs in every episode; omit this key"),
        ({"terrain": "slopes"}, r"terrain\.kind: unknown kind 'slopes'"),
    ],
)
def test_error_for_invalid_reset_options_names_the_key(keywords, message):
    with pytest.raises(ScenarioError, match=message):
        FollowPath(**keywords)


def test_observation_is_the_estimate_or_the_true_state_if_privileged():
    keywords = {"scenario": "circle", "overrides": {"duration_s": 3.0, "sensors.gnss.sigma_m": 0.2}}
    env = FollowPath(privileged=True, **keywords)
    steps = episode(env, 1)
    seen = {part.name: float(value) for part, value in zip(env.components, steps[-1][0], strict=True)}
    e, t = env.sim.estimate, env.sim.truth
    assert seen["cross_track"] == pytest.approx(hypot(e.x, e.y - 10) * -1 + 10, abs=1e-3)
    assert seen["true_cross_track"] == pytest.approx(hypot(t.x, t.y - 10) * -1 + 10, abs=1e-3)
    assert abs(seen["cross_track"] - seen["true_cross_track"]) > 1e-3
    assert seen["heading_error"] == pytest.approx(e.yaw - atan2(e.x, 10 - e.y), abs=1e-3)
    assert (seen["speed"], seen["yaw_rate"]) == pytest.approx((e.speed, e.yaw_rate), rel=1e-6)
    assert seen["curvature_3m"] == pytest.approx(0.1)
    assert steps[-1][4]["cross_track"] == pytest.approx(seen["true_cross_track"], abs=1e-6)
    plain = FollowPath(**keywords)
    own = episode(plain, 1)[-1][0]
    assert not [part.name for part in plain.components if part.name.startswith("true")]
    assert own.tobytes() == steps[-1][0][: len(own)].tobytes()


def test_actions_are_scaled_by_steering_limit_and_speed():
    env = FollowPath("circle", "bicycle", overrides={"path.ramp_s": 0.0}, speed=True)
    env.reset(seed=1)
    env.step(np.array([0.5, -0.25], dtype=np.float32))
    env.step(np.array([-9.0, 0.0], dtype=np.float32))
    log, limit = env.sim.log(), env.sim.scenario.tractor.steer_limit
    assert log.column("steer_ref") == pytest.approx([0.5 * limit, -limit])
    assert log.column("speed_ref") == pytest.approx([0.75 * 1.2, 1.2], rel=1e-3)


def test_without_a_speed_action_the_tractor_keeps_up_with_its_reference():
    env = FollowPath("straight_line", "bicycle", overrides={"duration_s": 15.0})
    env.reset(seed=1)
    over = False
    while not over:
        *_, failed, over, info = env.step(np.zeros(1))
    assert not failed
    assert abs(env.sim.log().column("e_longitudinal")[-1]) < 0.3
    assert info["metrics"]["xte_rms"] == env.sim.log().metrics["xte_rms"]


def test_reward_equals_the_documented_formula():
    env = FollowPath("circle", "bicycle", overrides=SHORT)
    env.reset(seed=1)
    turn, farthest = 0.0, env.sim.path.nearest(env.sim.truth.x, env.sim.truth.y, 0.0, 0.0).s
    rewards = []
    for action in actions(env, 25):
        _, reward, *_, info = env.step(action)
        truth, reference = env.sim.truth, env.sim.reference
        s = env.sim.path.nearest(truth.x, truth.y, farthest, truth.t).s
        share = min(max(s - farthest, 0.0) / (0.05 * max(hypot(reference.vx, reference.vy), 0.1)), 1.0)
        expected = share / (1 + (info["cross_track"] / 0.2) ** 2) - 0.1 * abs(float(action[0]) - turn)
        assert reward == pytest.approx(expected, abs=1e-9)
        turn, farthest = float(action[0]), max(farthest, s)
        rewards.append(reward)
    assert max(rewards) > 0.5


def test_episode_is_terminated_by_failure_and_truncated_by_time_limit():
    env = FollowPath("straight_line", "bicycle", overrides={"duration_s": 20.0}, max_offset_m=0.5)
    env.reset(seed=1)
    terminated = truncated = False
    while not (terminated or truncated):
        *_, terminated, truncated, info = env.step(np.ones(1))
    assert (terminated, truncated, info["outcome"]) == (True, False, "off_path")
    assert 0.5 < abs(info["cross_track"]) < 0.7
    last = episode(FollowPath(**FAST), 1)
    assert len(last) == 41
    assert [step[2:4] for step in last[:-1]] == [(False, False)] * 40
    assert last[-1][2:4] == (False, True)


def test_episode_of_a_failed_run_terminates_with_its_outcome():
    env = FollowPath("stuck_on_ice", max_lag_m=100.0)
    env.reset(seed=1)
    terminated = truncated = False
    while not (terminated or truncated):
        _, reward, terminated, truncated, info = env.step(np.zeros(1))
    assert (terminated, truncated, info["outcome"]) == (True, False, "stuck")
    assert np.isfinite(reward)


def test_episode_of_a_diverged_run_terminates_with_finite_values():
    env = FollowPath(privileged=True, **FAST)
    env.reset(seed=1)
    env.sim.loop.plant.state[:] = np.nan
    observed, reward, terminated, truncated, info = env.step(np.zeros(1))
    assert (terminated, truncated, info["outcome"]) == (True, False, "diverged")
    assert env.observation_space.contains(observed)
    assert np.isfinite(reward)


def test_invalid_actions_and_a_step_before_reset_are_rejected():
    env = FollowPath(**FAST)
    with pytest.raises(RuntimeError, match=r"call reset\(\) first"):
        env.step(np.zeros(1))
    env.reset(seed=1)
    for wrong in (np.zeros(0), np.zeros(2)):
        with pytest.raises(TypeError, match="action: must have 1 numbers, got "):
            env.step(wrong)
    with pytest.raises(ValueError, match="action: must be finite"):
        env.step(np.array([np.nan]))


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_vector_environment_equals_gymnasium_sync_vector_bit_for_bit(mode):
    keywords = {**VARIED, "max_offset_m": 0.05, "privileged": True}
    serial = SyncVectorEnv([lambda: FollowPath(**keywords)] * 5, autoreset_mode=mode)
    vector = FollowPathVector(5, autoreset_mode=mode, **keywords)
    ended = 0
    (o, i), (o2, i2) = serial.reset(seed=11), vector.reset(seed=11)
    assert o.tobytes() == o2.tobytes()
    assert {k: v.tolist() for k, v in i["drawn"].items()} == {k: v.tolist() for k, v in i2["drawn"].items()}
    for action in actions(serial, 70):
        one, two = serial.step(action), vector.step(action)
        assert [part.tobytes() for part in one[:4]] == [part.tobytes() for part in two[:4]]
        assert one[4]["cross_track"].tobytes() == two[4]["cross_track"].tobytes()
        assert one[4]["outcome"].tolist() == two[4]["outcome"].tolist()
        ended += int(one[2].sum() + one[3].sum())
    assert ended >= 10
    vector.close()


def test_reset_with_a_mask_resets_only_the_selected_environments():
    vector = FollowPathVector(3, autoreset_mode=AutoresetMode.DISABLED, **FAST)
    vector.reset(seed=[1, 2, 3])
    vector.step(np.zeros((3, 1), dtype=np.float32))
    mask = np.array([False, True, False])
    vector.reset(seed=[1, 2, 3], options={"reset_mask": mask})
    assert [env.unwrapped.sim.truth.t for env in vector.envs] == pytest.approx([0.05, 0.0, 0.05])
    vector.close()


def test_make_vec_creates_the_vector_environment():
    made = gymnasium.make_vec(ENV_ID, num_envs=2, **FAST)
    assert isinstance(made.unwrapped, FollowPathVector)
    assert made.reset(seed=1)[0].shape == (2, *made.single_observation_space.shape)
    made.close()


def test_state_of_an_episode_can_be_saved_and_branched():
    env = FollowPath("circle", overrides=SHORT)
    env.reset(seed=1)
    state = env.sim.save()
    first = [env.sim.step(steer=0.1).steer for _ in range(5)]
    env.sim.restore(state)
    assert [env.sim.step(steer=0.1).steer for _ in range(5)] == first
    assert isinstance(env.sim, Simulation)


def test_environment_is_registered_and_gymnasium_is_optional():
    done = python(
        "import sys, agrobot_mj, agrobot_mj.cli.app, agrobot_mj.simulation.stepping\n"
        "assert 'gymnasium' not in sys.modules\n"
        "import gymnasium\n"
        f"gymnasium.make('agrobot_mj.extensions.links.gym:{ENV_ID}', plant='bicycle').reset(seed=1)\n"
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_error_for_missing_gymnasium_gives_the_install_command():
    done = python("import sys; sys.modules['gymnasium'] = None\nimport agrobot_mj.extensions.links.gym")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].endswith(
        'agrobot_mj.extensions.links.gym needs gymnasium; pip install "agrobot-mj[gym]"'
    )


DRAW = """
import sys, numpy, gymnasium, agrobot_mj.extensions.links.gym
from agrobot_mj.extensions.links.gym.camera import NoDisplayError
for plant in ("mujoco", "bicycle"):
    env = gymnasium.make("agrobot_mj/FollowPath-v1", plant=plant, terrain="flat", render_mode="rgb_array",
                         image_size=(160, 120))
    env.reset(seed=1)
    env.step(numpy.ones(1, dtype=numpy.float32))
    try:
        picture = env.render()
    except NoDisplayError as error:
        sys.exit(f"no display: {error}")
    assert picture.shape == (120, 160, 3) and picture.dtype == numpy.uint8
    middle = picture[40:90, 50:110].reshape(-1, 3).astype(int)
    assert (middle[:, 2] > middle[:, 1] + 20).any(), "a blue tractor in the middle"
    assert (picture[..., 0].astype(int) > picture[..., 1] + 50).any(), "an orange path"
    env.close()
"""


def test_rendered_image_shows_the_tractor_and_its_path():
    done = python(DRAW, MUJOCO_GL=os.environ.get("MUJOCO_GL", "egl"))
    if "no display" in done.stderr or "OpenGL" in done.stderr:
        pytest.skip(f"MuJoCo cannot draw here: {done.stderr.strip().splitlines()[-1][:200]}")
    assert (done.returncode, done.stdout) == (0, ""), done.stderr


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only there is a display optional")
def test_missing_opengl_message_names_the_setting():
    surroundings = {"MUJOCO_GL": "glfw", "DISPLAY": "", "WAYLAND_DISPLAY": ""}
    done = python(DRAW, **surroundings)
    assert done.returncode == 1
    assert "no display: MuJoCo cannot find an OpenGL library for rendering" in done.stderr
    assert "MUJOCO_GL=egl" in done.stderr


def returned(policy, scenario, ticks=400, **keywords):
    """Return the sum of rewards and the last `info` of an episode. The policy receives observations by name."""
    env = FollowPath(scenario, **keywords)
    observed, _ = env.reset(seed=23)
    names, total = [part.name for part in env.components], 0.0
    for _ in range(ticks):
        action = policy(dict(zip(names, map(float, observed), strict=True)))
        observed, reward, terminated, truncated, info = env.step(np.array(action))
        total += reward
        if terminated or truncated:
            break
    return total, info


def steered(v):
    """Return the steering action of a law: curvature ahead, minus weighted cross-track and heading errors."""
    return float(np.clip(1.8 * v["curvature_1m"] - 0.5 * v["cross_track"] - 1.3 * v["heading_error"], -1.0, 1.0))


@pytest.mark.parametrize("scenario", ["figure_eight", "slalom", "uphill"])
def test_standstill_and_creep_speed_give_little_reward(scenario):
    driving, info = returned(lambda v: (steered(v), 0.5 * v["along_track"]), scenario, speed=True)
    assert info["outcome"] == ""
    assert info["lag"] < 1.0
    for speed, share in ((-1.0, 0.03), (-0.85, 0.15)):
        total, info = returned(lambda v, speed=speed: (steered(v), speed), scenario, speed=True)
        assert info["outcome"] == "lagging"
        assert total < share * driving


def test_progress_along_a_path_segment_is_rewarded_only_once():
    env = FollowPath("straight_line", speed=True)
    env.reset(seed=4)
    for _ in range(60):
        env.step(np.zeros(2))
    farthest = env.sim.truth.x
    while env.sim.truth.x > farthest - 0.3:
        env.sim.step(steer=0.0, speed=-1.0)
    while env.sim.truth.speed < 0.2 or env.sim.truth.x < farthest - 0.1:
        _, reward, *_ = env.step(np.zeros(2))
        assert reward == 0.0
    while env.sim.truth.x < farthest + 0.1:
        _, reward, *_ = env.step(np.zeros(2))
    assert reward > 0.5


def test_guidance_law_earns_more_reward_than_zero_steering():
    """Zero steering also earns reward, because most of the path before the headland turn is straight."""
    law, _ = returned(steered, "headland_k_turn", ticks=860)
    nothing, info = returned(lambda v: (0.0,), "headland_k_turn", ticks=860)
    assert info["outcome"] == "off_path"
    assert law > nothing + 10.0


def copied(env, way):
    return pickle.loads(pickle.dumps(env)) if way == "pickle" else getattr(copy, way)(env)


@pytest.mark.parametrize("way", ["copy", "deepcopy", "pickle"])
def test_copies_of_an_environment_are_independent(way):
    def on(env, count=7):
        found = [env.step(np.array([0.2])) for _ in range(count)]
        return [(step[0].tobytes(), *step[1:4], step[4]["cross_track"]) for step in found]

    def begun():
        env = FollowPath(**VARIED, privileged=True)
        env.reset(seed=31)
        env.step(np.array([-0.3]))
        return env

    expected, env = on(begun()), begun()
    one, two = copied(env, way), copied(env, way)
    two.step(np.array([0.9]))
    assert on(one) == expected == on(env)
    assert one.reset()[1]["drawn"] == env.reset()[1]["drawn"] != two.sim.scenario.seed
    env = begun()
    three = copied(env, way)
    env.close()
    del env
    assert on(three) == expected


def test_wrapped_environments_and_vector_environments_can_be_copied():
    made = gymnasium.make(ENV_ID, **FAST)
    made.reset(seed=3)
    vector = FollowPathVector(2, **FAST)
    vector.reset(seed=3)
    for env, action in ((made, np.array([0.1], dtype=np.float32)), (vector, np.full((2, 1), 0.1, dtype=np.float32))):
        for one in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
            assert one.step(action)[0].tobytes() == copy.deepcopy(env).step(action)[0].tobytes()
        assert copy.deepcopy(env).reset()[0].tobytes() == env.reset()[0].tobytes()
    vector.close()


@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="POSIX signals")
@pytest.mark.usefixtures("interruptible")
def test_interrupt_of_a_vector_step_leaves_all_tractors_between_ticks(monkeypatch):
    def driven(interrupted):
        vector, raised = FollowPathVector(3, **FAST), 0
        vector.reset(seed=5)
        if interrupted:
            advance = BicyclePlant.advance_held
            monkeypatch.setattr(
                BicyclePlant, "advance_held", lambda *a: os.kill(os.getpid(), signal.SIGINT) or advance(*a)
            )
        for _ in range(12):
            try:
                vector.step(np.full((3, 1), 0.15, dtype=np.float32))
            except KeyboardInterrupt:
                raised += 1
        return [env.sim.log().rows.values[: env.sim.rows.filled].tobytes() for env in vector.envs], raised

    expected, _ = driven(False)
    assert driven(True) == (expected, 12)
