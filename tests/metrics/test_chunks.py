"""Statistics of what is read in chunks are those of the whole."""

import numpy as np
import pytest

from agrobot_mj.core import chunked
from agrobot_mj.core.chunked import Chunked
from agrobot_mj.metrics.base import abs_p95, mean, rows_until


@pytest.mark.parametrize("chunk", [1, 7, 40, 10_000])
@pytest.mark.parametrize("size", [24, 25, 41, 1000])
def test_statistics_are_those_of_the_whole(size: int, chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunked, "CHUNK", chunk)
    values = np.random.default_rng(size).normal(size=size)
    values[1::9] = np.nan
    finite = values[np.isfinite(values)]
    assert abs_p95(Chunked.of(values)) == abs_p95(values) == np.percentile(np.abs(finite), 95)
    assert mean(Chunked.of(values)) == pytest.approx(np.mean(finite), abs=1e-12)
    t = np.arange(size) * 0.05
    assert rows_until(Chunked.of(t), t.tolist()) == list(range(1, size + 1))
    assert rows_until(Chunked.of(t), t.tolist(), "left") == list(range(size))
