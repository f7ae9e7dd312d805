"""Train a policy for the figure eight by the cross-entropy method, and compare it with the paper's PD law.

The policy is linear in a few observations, without a constant term, so that left and right bends share the weights:

    steering / limit = theta . (cross-track, heading error, yaw rate, steering angle, curvature ahead)

With --speed two more weights control the speed relative to the reference: a constant term, and a weight of the
along-track distance to the reference.

In each generation, policies are drawn from a normal distribution and simulated for a minute with different noise. The
best policies determine the next distribution. The initial mean is zero. Needs `pip install agrobot-mj[gym]`.

    python examples/train_figure_eight.py --out policy.npz
    python examples/train_figure_eight.py --speed --generations 8
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path

import gymnasium
import numpy as np

import agrobot_mj
import agrobot_mj.extensions.links.gym  # registers the environment

FEATURES = ("cross_track", "heading_error", "yaw_rate", "steer", "curvature_0m", "curvature_1m", "curvature_2m")
SPREAD = np.array([0.5, 1.0, 0.5, 0.5, 1.5, 1.5, 1.5])
"""Standard deviations of the steering weights in the first generation, in the order of `FEATURES`."""
SPEED_SPREAD = np.array([0.7, 0.3])
"""Standard deviations of the speed weights in the first generation: constant term, and weight of the distance [1/m]."""
ELITE = 0.25
"""Fraction of the policies of a generation that determines the next distribution [-]."""
KEPT_SPREAD = 0.03
"""Standard deviation added in each generation to continue exploration, divided by the initial value [-]."""
JUDGED_SEEDS = range(9001, 9006)
"""Seeds of the final comparison, not used in training."""


@cache
def environment(plant, duration_s, speed):
    """Return the Gymnasium environment, which is created once per process."""
    overrides = {} if duration_s is None else {"duration_s": duration_s}
    keywords = {"scenario": "figure_eight", "plant": plant, "speed": speed, "overrides": overrides}
    return gymnasium.make(agrobot_mj.extensions.links.gym.ENV_ID, **keywords)


def episode(job):
    """Simulate one episode. Return the sum of rewards, the last `info`, and the processor time [s]."""
    theta, plant, duration_s, seed, options = job
    began = time.process_time()
    steering, driving = theta[: len(FEATURES)], theta[len(FEATURES) :]
    env = environment(plant, duration_s, speed=bool(driving.size))
    names = [part.name for part in env.unwrapped.components]
    columns, along = [names.index(feature) for feature in FEATURES], names.index("along_track")
    seen, _ = env.reset(seed=seed, options=options)
    total, over, info = 0.0, False, {}
    while not over:
        wanted = [steering @ seen[columns], *([driving @ (1.0, seen[along])] if driving.size else [])]
        action = np.clip(wanted, -1.0, 1.0).astype(np.float32)
        seen, reward, failed, ended, info = env.step(action)
        total, over = total + reward, failed or ended
    return total, info, time.process_time() - began


def train(pool, plant, speed, generations, population, duration_s, seed):
    """Train a policy, and yield the mean weights after each generation."""
    draw = np.random.default_rng(seed)
    first = np.append(SPREAD, SPEED_SPREAD) if speed else SPREAD
    mean, spread = np.zeros(len(first)), first.copy()
    for generation in range(generations):
        began = time.perf_counter()
        thetas = mean + spread * draw.standard_normal((population, len(first)))
        seeds = draw.integers(2**31, size=population).tolist()
        jobs = [(theta, plant, duration_s, s, None) for theta, s in zip(thetas, seeds, strict=True)]
        driven = list(pool.map(episode, jobs))
        returns, cpu = np.array([total for total, _, _ in driven]), sum(seconds for _, _, seconds in driven)
        best = thetas[np.argsort(returns)[-max(2, round(ELITE * population)) :]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + KEPT_SPREAD * first
        wall = time.perf_counter() - began
        print(f"{generation:3d}  best {returns.max():7.1f}  median {np.median(returns):7.1f}", end="  ")
        print(f"{wall:5.1f} s, {cpu:5.1f} s of processor time", flush=True)
        yield mean


def driven_by_pd(job):
    """Return the metrics of a run with the paper's PD law."""
    plant, duration_s, seed = job
    overrides = {"controller.kind": "pd", "plant.kind": plant, "seed": seed}
    overrides |= {} if duration_s is None else {"duration_s": duration_s}
    return agrobot_mj.run(agrobot_mj.load_scenario("figure_eight", overrides)).metrics


def judge(pool, theta, plant, duration_s):
    """Print the errors of the policy and of the PD law with the same noise. Return the mean RMS lateral error of each
    law [m]."""
    seeds = list(JUDGED_SEEDS)
    jobs = [(theta, plant, duration_s, 0, {"overrides": {"seed": seed}}) for seed in seeds]
    ends = [info for _, info, _ in pool.map(episode, jobs)]
    laws = {
        "learnt": [info.get("metrics", {}) | {"outcome": info["outcome"]} for info in ends],
        "PD": list(pool.map(driven_by_pd, [(plant, duration_s, seed) for seed in seeds])),
    }
    found = {}
    for name, rows in laws.items():
        lateral, cross = (np.array([row[key] for row in rows]) for key in ("lateral_rms", "xte_rms"))
        outcomes = sorted({row["outcome"] for row in rows})
        print(f"{name:7s} lateral rms {100 * lateral.mean():5.1f} cm ({100 * lateral.min():.1f} to", end=" ")
        print(f"{100 * lateral.max():.1f}), cross-track rms {100 * cross.mean():5.1f} cm", end=", ")
        print(f"{100 * np.mean([row['progress'] for row in rows]):.0f} % of the path, {', '.join(outcomes)}")
        found[name] = float(lateral.mean())
    return found


def main():
    """Train a policy, compare it with the PD law, and save it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plant", default="mujoco", choices=["mujoco", "bicycle"])
    parser.add_argument("--speed", action="store_true", help="learn the speed as well")
    parser.add_argument("--generations", type=int, default=12)
    parser.add_argument("--population", type=int, default=24)
    parser.add_argument("--duration", type=float, default=60.0, help="duration of a training episode [s]")
    parser.add_argument("--judge-duration", type=float, help="duration of a compared run [s]; default: two turns")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="file for the policy (.npz)")
    options = parser.parse_args()
    began = time.perf_counter()
    with ProcessPoolExecutor(options.workers) as pool:
        size = options.generations, options.population
        for theta in train(pool, options.plant, options.speed, *size, options.duration, options.seed):
            if options.out:
                np.savez(options.out, features=FEATURES, theta=theta)
        print(f"trained in {time.perf_counter() - began:.0f} s")
        names = (*FEATURES, *(("speed", "speed by along_track") if options.speed else ()))
        print(", ".join(f"{name} {value:.3f}" for name, value in zip(names, theta, strict=True)))
        judge(pool, theta, options.plant, options.judge_duration)


if __name__ == "__main__":
    main()
