"""Pairs of two test parameters. By default, each value of the first parameter occurs in one pair. With the mark `slow`,
all pairs are tested."""

import pytest


def by_turns(firsts, seconds):
    """Return parameters for `pytest.mark.parametrize`, one for each pair of values from the two lists. Values may be
    `pytest.param`."""
    return [
        pytest.param(
            *_values(first),
            *_values(second),
            id="-".join([*_name(first), *_name(second)]) or None,
            marks=[*_marks(first), *_marks(second), *([] if j == i % len(seconds) else [pytest.mark.slow])],
        )
        for i, first in enumerate(firsts)
        for j, second in enumerate(seconds)
    ]


def _values(item):
    return item.values if isinstance(item, type(pytest.param())) else (item,)


def _marks(item):
    return item.marks if isinstance(item, type(pytest.param())) else ()


def _name(item):
    """Return the parts of the test id for a parameter."""
    if isinstance(item, type(pytest.param())):
        return [item.id] if item.id else [str(value) for value in item.values]
    return [str(item)]
