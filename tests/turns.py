"""Pairs of two test parameters: by default one pair for each value of the first parameter; all pairs with `slow`."""

import pytest


def by_turns(firsts, seconds):
    """Return parameters for `parametrize`, one for each pair of the two lists. Items may be `pytest.param`."""
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
