"""Splitting of processes with known probability: walks with integer steps, which have many ties, or normal steps."""

from functools import cache
from math import inf, sqrt
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
import pytest

from agrobot_mj.extensions.search.risk.splitting import Split, estimate, split_paths


class Walk(NamedTuple):
    """Random walk from 0, which fails if its maximum reaches `top`."""

    places: np.ndarray
    top: float

    @property
    def level(self):
        highest = self.places.max()
        return inf if highest >= self.top else highest


class Process(NamedTuple):
    """Random walk of `steps` steps: normal steps, or unit steps that go up with the probability `up`."""

    steps: int
    top: float
    up: float | None = None
    drift: float = 0.0

    def drive(self, wanted, random):
        """Return a new random walk, or a copy up to its first position above the level."""
        parent, level = wanted
        begun = np.zeros(1) if parent is None else parent.places[: np.argmax(parent.places > level) + 1]
        left = self.steps + 1 - len(begun)
        if self.up is None:
            steps = self.drift + random.standard_normal(left)
        else:
            steps = np.where(random.random(left) < self.up, 1.0, -1.0)
        return Walk(np.concatenate([begun, begun[-1] + np.cumsum(steps)]), self.top)

    def estimate(self, n, worst, seed, least=1e-12):
        random = np.random.default_rng(seed)
        work = split_paths(n, worst, least, random)
        wanted = next(work)
        while True:
            try:
                wanted = work.send([self.drive(each, random) for each in wanted])
            except StopIteration as end:
                return end.value

    @property
    def exact(self):
        """Probability that the maximum of the walk reaches `top`."""
        return _exact_of_whole_steps(self) if self.up is not None else _exact_of_normal_steps(self)


@cache
def _exact_of_whole_steps(p):
    chance = np.zeros(p.steps + int(p.top) + 1)  # of the places below the top, downwards from top - 1
    chance[int(p.top) - 1] = 1.0
    reached = 0.0
    for _ in range(p.steps):
        reached += p.up * chance[0]
        up, down = p.up * chance, (1 - p.up) * chance
        chance = np.append(up[1:], 0.0) + np.insert(down[:-1], 0, 0.0)
    return reached


@cache
def _exact_of_normal_steps(p, spacing=0.05):
    """Return the probability by convolution of the density below `top` with the density of a step, on a grid."""
    depth = p.top + (8 + abs(p.drift) * sqrt(p.steps)) * sqrt(p.steps)
    x = p.top - spacing * (np.arange(int(depth / spacing)) + 0.5)
    width = np.arange(-8, 8 + spacing / 2, spacing)
    step = np.exp(-0.5 * (width + p.drift) ** 2) / sqrt(2 * np.pi) * spacing  # x falls with its place
    density = np.exp(-0.5 * (x - p.drift) ** 2) / sqrt(2 * np.pi)
    for _ in range(p.steps - 1):
        density = np.convolve(density, step, mode="same")
    return 1.0 - density.sum() * spacing


WHOLE = Process(steps=60, top=20, up=0.45)
NORMAL = Process(steps=40, top=24.0, drift=-0.05)
SHORT = [Process(steps=30, top=8, up=0.45), Process(steps=15, top=9.0, drift=-0.05)]


def means(process, n, worst, repeats, first=0):
    found = [process.estimate(n, worst, seed).probability for seed in range(first, first + repeats)]
    return np.mean(found), np.std(found, ddof=1) / sqrt(repeats)


def test_reference_probabilities_of_random_walks_agree_with_theory():
    """Theory: P(max >= a) = 2 P(S > a) + P(S = a) for symmetric unit steps; Siegmund's correction for normal steps."""
    even = Process(steps=20, top=6, up=0.5)
    ends = 20 - 2 * np.random.default_rng(1).binomial(20, 0.5, 400_000)
    assert even.exact == pytest.approx(2 * np.mean(ends > 6) + np.mean(ends == 6), abs=0.005)
    normal = Process(steps=400, top=40.0)
    corrected = 2 * NormalDist().cdf(-(normal.top + 0.5826) / sqrt(normal.steps))
    assert normal.exact == pytest.approx(corrected, rel=0.02)
    assert 1e-4 < WHOLE.exact < 2e-3
    assert 1e-5 < NORMAL.exact < 1e-3


@pytest.mark.parametrize("process", SHORT, ids=["whole steps", "normal steps"])
@pytest.mark.parametrize(("n", "worst"), [(2, 1), (4, 1), pytest.param(20, 5, marks=pytest.mark.slow)])
def test_splitting_estimate_is_unbiased_for_few_paths(process, n, worst):
    mean, error = means(process, n, worst, 1000)
    assert error < 0.15 * process.exact
    assert mean == pytest.approx(process.exact, abs=3 * error)


def test_standard_error_without_splitting_is_binomial():
    found = estimate([Split(failed / 50, 1.0, failed, (), 50) for failed in (20, 25, 15, 20)], 50)
    assert found.probability == pytest.approx(0.4)
    assert found.error == pytest.approx(sqrt(0.4 * 0.6 / 200))
    assert found.low == pytest.approx(0.4 - 1.96 * found.error, abs=0.005)
    assert found.high == pytest.approx(0.4 + 1.96 * found.error, abs=0.005)


def split_with(*families):
    """Return a splitting of 10 paths with the weight 1e-3 and the given numbers of failed paths per family."""
    failed = sum(families)
    return Split(1e-4 * failed, 1e-3, failed, ((0.0, 1e-3),), 40, families)


def test_interval_is_a_poisson_interval_of_families_of_equal_weight():
    """All splittings give the same probability, so that their spread is zero."""
    found = estimate([split_with(1, 1, 1, 1)] * 5, 10)
    assert found.error == pytest.approx(0.0, abs=1e-12)
    assert found.low / found.probability == pytest.approx(24.433 / 40, rel=1e-4)  # table of chi-square, 40 degrees
    assert found.high / found.probability == pytest.approx(61.777 / 40, rel=1e-4)  # 42 degrees of freedom


def test_interval_is_wider_if_one_family_dominates():
    equal, dominated = estimate([split_with(1, 1, 1, 1)] * 5, 10), estimate([split_with(4)] * 5, 10)
    assert dominated.probability == equal.probability
    assert dominated.low < equal.low < equal.high < dominated.high


@pytest.mark.parametrize("seed", range(4))
def test_families_count_the_failed_paths_of_each_initial_path(seed):
    """Of four initial paths, only the first two rise, and all copies of them fail."""
    work = split_paths(4, 2, 1e-9, np.random.default_rng(seed))
    next(work)
    failed = Walk(np.array([0.0, 9.0]), 9.0)
    wanted = work.send([Walk(np.array([0.0, top]), 9.0) for top in (5.0, 6.0, 1.0, 1.0)])
    parents = {parent.places[-1] for parent, _ in wanted}
    work.send([failed] * len(wanted))
    with pytest.raises(StopIteration) as end:
        work.send([failed] * 2)
    found = end.value.value
    assert (found.failed, len(found.families)) == (4, len(parents))
    assert sum(found.families) == 4
