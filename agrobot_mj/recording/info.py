"""Markdown texts of a recording: the scenario and, after the run, outcome and metrics."""

from collections.abc import Sequence
from typing import Any

import rerun as rr

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.palette import NAMES
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.core.version import __version__
from agrobot_mj.metrics import unit_of
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log


def describe(stream: rr.RecordingStream, name: str, scenario: Scenario) -> None:
    """Set the name and properties of a recording, and send the complete scenario as TOML text."""
    stream.send_recording_name(name)
    identity = str(scenario.identity)
    about = rr.AnyValues(version=__version__, identity=identity, seed=scenario.seed, name=scenario.name)
    stream.send_property("scenario", about)
    tell(stream, f"```toml\n{scenario.portable()[0]}```\n", "scenario")


def tell(stream: rr.RecordingStream, text: str, entity: str = "info") -> None:
    """Send a Markdown text to the Rerun entity `entity` of a recording."""
    stream.log(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def running(scenario: Scenario) -> str:
    """Return the Markdown text that a recording contains while the run is in progress."""
    return _page(scenario, "*The run is active or was killed before its end.*")


def exception_text(scenario: Scenario, error: BaseException, t: float) -> str:
    """Return the Markdown text that a recording contains after an exception at the time `t` [s]."""
    return _page(scenario, f"**ended by an error** after {t:.2f} s: `{type(error).__name__}: {error}`")


def summary(log: Log) -> str:
    """Return the Markdown text that a recording contains after the run: outcome and metrics."""
    end = (
        f"**{log.outcome}** after {log.rows.filled * TICK_S:.2f} s, {log.wall_s:.2f} s of wall time; "
        f"{'as expected' if log.as_expected else f'**expected: {log.scenario.expectation}**'}."
    )
    name = log.scenario.guidance.outside  # an external guidance program has its own metrics
    outside = [_metrics(log.metrics[name], name)] if name in log.metrics else []
    parts = end, _metrics(log.metrics, "Metrics"), *outside, _turns(log.metrics), _passes(log.metrics)
    return _page(log.scenario, "\n\n".join(parts))


COMPARED = ("lateral_mse", "lateral_rms", "longitudinal_rms", "xte_rms", "yaw_rate_error_rms")


def comparison_text(scenario: Scenario, runs: Sequence[tuple[str, int, Log]]) -> str:
    """Return the Markdown text of a comparison; `runs` contains name, colour 0xRRGGBBAA and log of each run."""
    shown = [name for name in COMPARED if any(log.metrics[name] is not None for *_, log in runs)]
    heads = ("run", "colour", "outcome", *(f"{name} [{unit_of(name)}]" for name in shown))
    rows = [
        (
            *(name, f"#{colour >> 8:06x} {NAMES.get(f'#{colour >> 8:06X}', '')}", log.outcome),
            *(_cell(log.metrics[metric]) for metric in shown),
        )
        for name, colour, log in runs
    ]
    return (
        f"# {scenario.title or scenario.name}: {len(runs)} runs\n\nseed {scenario.seed}, agrobot_mj {__version__}; "
        "the scenario view shows the first run\n\nThe solid tractor belongs to the last run; the others are "
        "translucent. Errors are position minus reference; left of the path and ahead are positive.\n\n"
        f"{markdown_table(heads, rows)}\n"
    )


def _page(scenario: Scenario, result: str) -> str:
    s = scenario
    outside = f", external program (`agrobot-mj {s.guidance.outside}`)" if s.guidance.outside else ""
    what = f"`{s.name}`: plant **{s.plant.kind}**, guidance **{s.law}**{outside}, seed {s.seed}"
    return f"# {s.title or s.name}\n\n{what}\n\nagrobot_mj {__version__}, identity `{s.identity}`\n\n{result}\n"


def _metrics(metrics: dict[str, Any], title: str) -> str:
    rows = [
        (name, _cell(value), unit_of(name)) for name, value in metrics.items() if isinstance(value, int | float | str)
    ]
    return f"## {title}\n\n{markdown_table(('metric', 'value', 'unit'), rows)}"


def _turns(metrics: dict[str, Any]) -> str:
    turns, shares = metrics["per_turn"], metrics["nn_share"]
    if not turns:
        return ""
    names = [name for name in turns[0] if name not in ("turn", "complete")]
    heads = [f"turn {turn['turn']}{'' if turn['complete'] else ' (in part)'}" for turn in turns]
    rows = [(name, *(_cell(turn[name]) for turn in turns), unit_of(name)) for name in names]
    rows.append(("nn_share", *map(_cell, shares), "-"))
    return f"## Turn by turn\n\n{markdown_table(('metric', *heads, 'unit'), rows)}"


def _passes(metrics: dict[str, Any]) -> str:
    found = metrics.get("iso_12188_2_style")
    if found is None:
        return ""
    total = [(name, value) for name, value in found.items() if name not in ("label", "per_pass")]
    names = [name for name in found["per_pass"][0] if name not in ("pass", "complete")]
    whole = markdown_table(("metric", "value", "unit"), [(name, _cell(value), "m") for name, value in total])
    rows = [
        (f"{one['pass']}{'' if one['complete'] else ' (in part)'}", *(_cell(one[name]) for name in names))
        for one in found["per_pass"]
    ]
    passes = markdown_table(("pass", *(f"{name} [m]" for name in names)), rows)
    return f"## Pass to pass, {found['label']}\n\n{whole}\n\n{passes}"


def _cell(value: float | str | None) -> str:
    return "-" if value is None else value if isinstance(value, str) else f"{value:.4g}"
