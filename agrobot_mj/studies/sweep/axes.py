"""Values of a sweep: what an axis runs through, and what a draw is drawn from."""

from collections.abc import Mapping
from math import floor, isclose, isfinite, log
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import Spec


def _number(given: Any) -> Any:
    if isinstance(given, bool) or not isinstance(given, int | float) or not isfinite(given):
        raise ValueError(f"must be a number, got {given!r}")
    return given


Number = Annotated[int | float, BeforeValidator(_number)]
Pair = Annotated[tuple[Number, Number], Field(min_length=2, max_length=2)]


class ValueList(Spec):
    """Values of an axis: `len` of them, `at(k)` is one."""

    def __len__(self) -> int:
        raise NotImplementedError

    def at(self, k: int) -> Any:
        """Value number `k`, from 0."""
        raise NotImplementedError

    @property
    def written(self) -> list[Any]:
        """The axis as a plain list."""
        return [self.at(k) for k in range(len(self))]

    @property
    def of_tables(self) -> bool:
        """Whether a value is a table."""
        return False


class Listed(ValueList):
    """Values one by one, in TOML a plain list."""

    values: Annotated[tuple[Any, ...], Field(min_length=1)]

    @model_validator(mode="before")
    @classmethod
    def _from_list(cls, given: Any) -> Any:
        return {"values": tuple(given)} if isinstance(given, list) else given

    def __len__(self) -> int:
        return len(self.values)

    def at(self, k: int) -> Any:
        """Value number `k`, from 0."""
        return self.values[k]

    @property
    def of_tables(self) -> bool:
        """Whether a value is a table."""
        return any(isinstance(value, dict) for value in self.values)


class Linspace(ValueList):
    """A number of values at equal distances, both ends included."""

    start: Number = Field(alias="from")
    """First value."""
    stop: Number = Field(alias="to")
    """Last value."""
    count: Annotated[int, Field(ge=1)]
    """Number of values [-]."""

    def __len__(self) -> int:
        return self.count

    def at(self, k: int) -> Number:
        """Value number `k`, from 0; whole numbers stay such."""
        if self.count == 1:
            return self.start
        span, gaps = self.stop - self.start, self.count - 1
        if isinstance(span, int) and span % gaps == 0:
            return self.start + k * (span // gaps)
        return _tidy(self.start + span * k / gaps)


class Steps(ValueList):
    """Values at a given distance; the last one is at or before `to`."""

    start: Number = Field(alias="from")
    """First value."""
    stop: Number = Field(alias="to")
    """Limit of the values."""
    step: Number
    """Distance between values, negative to go down."""

    @model_validator(mode="after")
    def _gets_there(self) -> "Steps":
        if self.step == 0 or (self.stop - self.start) / self.step < 0:
            raise ValueError(f"step: leads nowhere from {self.start} to {self.stop}; change its sign")
        return self

    def __len__(self) -> int:
        # A step that divides the span but for rounding reaches the end.
        return floor((self.stop - self.start) / self.step + 1e-9) + 1

    def at(self, k: int) -> Number:
        """Value number `k`, from 0; whole numbers stay such."""
        value = self.start + k * self.step
        return value if isinstance(value, int) else _tidy(value)


def _axis_tag(given: Any) -> str:
    if isinstance(given, list):
        return "list"
    return "steps" if isinstance(given, Mapping) and "step" in given else "linspace"


Axis = Annotated[
    Annotated[Listed, Tag("list")] | Annotated[Linspace, Tag("linspace")] | Annotated[Steps, Tag("steps")],
    Discriminator(_axis_tag),
]


class Draw(Spec):
    """A distribution. `values` maps numbers that are uniform on (0, 1), shape (n,), to as many values."""

    def values(self, u: Array) -> list[Any]:
        """The quantiles of `u`, so that a Latin hypercube or a Sobol sequence stays one."""
        raise NotImplementedError

    @property
    def written(self) -> Any:
        """The draw as the file says it."""
        return self.model_dump(mode="json", exclude_unset=True)


class Uniform(Draw):
    """Uniform between two limits."""

    uniform: Pair
    """Lowest and highest value."""

    @model_validator(mode="after")
    def _in_order(self) -> "Uniform":
        _ascending("uniform", self.uniform)
        return self

    def values(self, u: Array) -> list[Any]:
        """Quantiles of the uniform distribution."""
        low, high = self.uniform
        return [_tidy(value) for value in (low + (high - low) * u).tolist()]


class LogUniform(Draw):
    """Uniform in the logarithm: as many values per decade."""

    log_uniform: Pair
    """Lowest and highest value, above 0."""

    @model_validator(mode="after")
    def _in_order(self) -> "LogUniform":
        _ascending("log_uniform", self.log_uniform)
        if self.log_uniform[0] <= 0:
            raise ValueError(f"log_uniform: must be above 0, got {self.log_uniform[0]}")
        return self

    def values(self, u: Array) -> list[Any]:
        """Quantiles of the log-uniform distribution."""
        low, high = map(log, self.log_uniform)
        return [_tidy(value) for value in np.exp(low + (high - low) * u).tolist()]


class Normal(Draw):
    """Normal distribution, cut off at the limits of `within` if given."""

    normal: Pair
    """Mean and standard deviation."""
    within: Pair | None = None
    """Lowest and highest value; the distribution between them is scaled up, not piled up at the ends."""

    @model_validator(mode="after")
    def _sensible(self) -> "Normal":
        if self.normal[1] <= 0:
            raise ValueError(f"normal: the second number is the standard deviation, above 0, got {self.normal[1]}")
        if self.within:
            _ascending("within", self.within)
        return self

    def values(self, u: Array) -> list[Any]:
        """Quantiles of the (truncated) normal distribution."""
        from scipy.stats import norm

        mean, deviation = self.normal
        low, high = norm.cdf([(limit - mean) / deviation for limit in self.within or (-np.inf, np.inf)])
        return [_tidy(value) for value in (mean + deviation * norm.ppf(low + (high - low) * u)).tolist()]


class Choice(Draw):
    """One of some values, all as likely."""

    choice: Annotated[tuple[Any, ...], Field(min_length=1)]
    """The values."""

    def values(self, u: Array) -> list[Any]:
        """Values by equal shares of (0, 1)."""
        n = len(self.choice)
        return [self.choice[min(int(value * n), n - 1)] for value in u.tolist()]


def _draw_tag(given: Any) -> str:
    return next((tag for tag in DRAWS if isinstance(given, Mapping) and tag in given), "no distribution")


DRAWS = ("uniform", "normal", "log_uniform", "choice")
"""Distributions by the key that names them."""
AnyDraw = Annotated[
    Annotated[Uniform, Tag("uniform")]
    | Annotated[Normal, Tag("normal")]
    | Annotated[LogUniform, Tag("log_uniform")]
    | Annotated[Choice, Tag("choice")],
    Discriminator(_draw_tag),
]


def _ascending(key: str, pair: tuple[Number, Number]) -> None:
    if not pair[0] < pair[1] or isclose(*pair, rel_tol=1e-15):
        raise ValueError(f"{key}: the first number must be below the second, got {list(pair)}")


def _tidy(value: float) -> float:
    """The value without the digits that rounding leaves, so that 0.1 * 3 reads 0.3."""
    return float(f"{value:.12g}")
