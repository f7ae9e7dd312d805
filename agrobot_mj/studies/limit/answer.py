"""The answer of a search as a verdict and a sentence: what held, failed, was not tried, and what a hardship took."""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

from agrobot_mj.studies.limit.question import Counterpart, Found, Question, Tried
from agrobot_mj.studies.statistics import runs_needed


def answer(name: str, q: Question, tried: tuple[Tried, ...]) -> Found:
    """Verdict on the values that were tried, from the start of the range on, with what they do not show."""
    found = _verdict(name, q, tried)
    parts = [found.statement, *_coverage(tried), *_caveats(q, tried)]
    if unexpected := [f"{t.ends} at {t.value:g}" for t in tried if t.unexpected]:
        parts.append(f"Not every run ended as expected: {'; '.join(unexpected)}")
    return found._replace(statement=". ".join(parts))


def _verdict(name: str, q: Question, tried: tuple[Tried, ...]) -> Found:
    """The verdict on what was tried."""
    found = partial(Found, name, tried=tried)
    terms = f"{100 * q.reliability:g} % of runs at {100 * q.confidence:g} % confidence"
    works, fails = [t for t in tried if t.holds], [t for t in tried if not t.holds]
    if not fails:
        text = (
            f"{name} does not fail at the values tried of {q.key} ({tried[-1].share} at {tried[-1].value:g}; {terms})"
        )
        return found(verdict="never_fails", limit=None, interval=None, statement=text)
    if not works:
        text = f"{name} fails at all values tried, from {q.key} = {tried[0].value:g} on ({tried[0].share} there)"
        return found(verdict="always_fails", limit=None, interval=None, statement=text)
    if not tried[0].holds:
        first, there = tried[0], ", ".join(f"{t.value:g}" for t in works)
        advice = "turn the range round?" if first.certain else "more seeds, or begin where it holds"
        begin = f"{q.key} = {first.value:g} ({first.share} succeed)"
        text = f"{name} does not hold at the start, {begin}, but at {there}; {advice}"
        return found(verdict="fails_at_start", limit=None, interval=None, statement=text)
    first_bad = next(k for k, t in enumerate(tried) if not t.holds)
    good, bad = tried[first_bad - 1], tried[first_bad]
    interval = _interval(tried, first_bad)
    # Where the runs leave it open, the rate goes up and down by chance.
    few = q.seeds < runs_needed(q.reliability, q.confidence)
    again = [t.value for t in tried[first_bad:] if t.holds and (t.certain or few)]
    text = f"{name} holds up to {q.key} = {good.value:g} ({good.share})"
    text += f", fails from {bad.value:g} on ({bad.share}; {terms})"
    if (good.value, bad.value) != interval:
        text += f"; for certain, it holds at {interval[0]:g} and fails at {interval[1]:g}"
    if again:
        text += f", but works again at {', '.join(f'{value:g}' for value in again)}: one number does not describe it"
    verdict = "not_monotone" if again else "limit"
    return found(verdict=verdict, limit=(good.value + bad.value) / 2, interval=interval, statement=text)


def _interval(tried: tuple[Tried, ...], first_bad: int) -> tuple[float, float]:
    """The last value before the change that certainly holds, and the first one after it that certainly fails."""
    before = [t.value for t in tried[:first_bad] if t.certain]
    after = [t.value for t in tried[first_bad:] if t.certain and not t.holds]
    return before[-1] if before else tried[0].value, after[0] if after else tried[-1].value


def _coverage(tried: Sequence[Tried]) -> list[str]:
    """Which values were tried, and how wide an island between them nobody would have seen."""
    held, failed = (", ".join(f"{t.value:g}" for t in tried if t.holds is holds) for holds in (True, False))
    seen = [*([f"Held at {held}"] if held else []), *([f"failed at {failed}"] if failed else [])]
    gaps = [abs(b.value - a.value) for a, b in pairwise(tried) if a.holds == b.holds]
    text = "; ".join(seen)
    text = f"{text[0].upper()}{text[1:]}; nothing was tried between"
    return [f"{text}, where an island of up to {max(gaps):g} would not be seen" if gaps else text]


def _caveats(q: Question, tried: Sequence[Tried]) -> list[str]:
    """What limits the intervals: seeds that change nothing, and few runs at values on the way."""
    if not all(t.independent for t in tried):
        which = ", ".join(f"{t.value:g}" for t in tried if not t.independent)
        where = "" if not any(t.independent for t in tried) else f" at {which}"
        return [f"Seeds change nothing{where}: one run is all there is to know, without an interval"]
    if q.seeds < (needed := runs_needed(q.reliability, q.confidence)):
        return [f"Values on the way are judged by the rates of {q.seeds} runs; certainty needs {needed}"]
    return []


def answer_beside(found: Found, q: Question, sound: Found, overrides: Mapping[str, Any]) -> Counterpart:
    """The answer of the counterpart's own search, with what the hardship took of the limit."""
    text = f"with {_shown(overrides)}: {sound.statement.removeprefix(sound.law + ' ').split('. ')[0]}"
    return Counterpart(dict(overrides), sound.verdict, sound.limit, f"{text}; {_taken(found, q, sound)}", sound.tried)


def _taken(found: Found, q: Question, sound: Found) -> str:
    """What the hardship takes of a limit, in a few words."""
    if found.limit is None or sound.limit is None:
        same = found.verdict == sound.verdict
        return "the same without the hardship" if same else "compare the two: one of them has no limit in the range"
    taken = abs(sound.limit - q.start) - abs(found.limit - q.start)
    if abs(taken) <= q.resolution:
        return f"the hardship takes nothing that steps of {q.resolution:g} can tell"
    return f"the hardship {'takes' if taken > 0 else 'adds'} {abs(taken):.3g}"


def answer_fixed(found: Found, runs: Tried, overrides: Mapping[str, Any]) -> Counterpart:
    """The answer of a counterpart with nothing to vary: how its runs end, and how much of the condition they use."""
    medians = "".join(f", median {name} {value:.3g}" for name, value in runs.medians.items())
    text = f"with {_shown(overrides)}: {runs.share} succeed{medians}"
    if found.verdict == "always_fails" and not runs.holds:
        text += "; it fails without the hardship, too"
    return Counterpart(dict(overrides), "fixed", None, text, (runs,))


def _shown(overrides: Mapping[str, Any]) -> str:
    return ", ".join(f"{key}={value}" for key, value in overrides.items())
