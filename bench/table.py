"""The results of benchmarks, one row per figure, and their output as a table and as JSON."""

import math
from collections.abc import Sequence
from typing import NamedTuple


class Row(NamedTuple):
    """One figure. ``reference``: what it is compared with in the same run, empty if nothing."""

    name: str
    unit: str
    value: float
    reference: str
    ratio: float | None
    """The ratio of ``value`` to the reference."""
    goal: str
    holds: bool | None
    """True if the goal is reached; None without a goal."""


class UnavailableError(Exception):
    """A prerequisite of a benchmark is missing; the message says which, and how to get it."""


def at_least(name: str, unit: str, value: float, reference: str, beside: float, share: float) -> Row:
    """Return the row of a rate whose goal is at least ``share`` of its reference."""
    ratio = value / beside
    return Row(name, unit, value, reference, ratio, f">= {share:.0%} of it", ratio >= share)


def at_most(name: str, value_ms: float, reference: str, beside_ms: float, most_ms: float) -> Row:
    """Return the row of a time whose goal is at most ``most_ms``."""
    return Row(name, "ms", value_ms, reference, value_ms / beside_ms, f"<= {most_ms:g} ms", value_ms <= most_ms)


def within(name: str, value_ms: float, reference: str, beside_ms: float, times: float, more_ms: float = 0.0) -> Row:
    """Return the row of a time whose goal is at most a multiple of its reference, plus ``more_ms``."""
    more = f" + {more_ms:g} ms" if more_ms else ""
    held = value_ms <= times * beside_ms + more_ms
    return Row(name, "ms", value_ms, reference, value_ms / beside_ms, f"<= {times:g} times it{more}", held)


def bounded(name: str, unit: str, value: float, most: float) -> Row:
    """Return the row of a figure whose goal is at most ``most``, and which has no reference."""
    return Row(name, unit, value, "", None, f"<= {most:g} {unit}", value <= most)


def known(name: str, unit: str, value: float, reference: str = "", beside: float = math.nan) -> Row:
    """Return the row of a figure without a goal."""
    return Row(name, unit, value, reference, value / beside if reference else None, "", None)


def percentile(values: Sequence[float], share: float) -> float:
    """Return the value below which ``share`` (0 to 1) of all values lie."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(len(ordered) * share))]


def median(runs: Sequence[Sequence[Row]]) -> list[Row]:
    """Return the medians of values and ratios of each figure. A goal counts as reached if most runs reached it."""
    names = dict.fromkeys(row.name for run in runs for row in run)
    return [_middle([row for run in runs for row in run if row.name == name]) for name in names]


def _middle(rows: Sequence[Row]) -> Row:
    ratios = sorted(row.ratio for row in rows if row.ratio is not None)
    held = sorted(row.holds for row in rows if row.holds is not None)
    value = sorted(row.value for row in rows)[len(rows) // 2]
    return rows[0]._replace(
        value=value,
        ratio=ratios[len(ratios) // 2] if ratios else None,
        holds=held[len(held) // 2] if held else None,
    )


def markdown(rows: Sequence[Row]) -> str:
    lines = ["| | value | | ratio | beside | goal | |", "|---|--:|---|--:|---|---|---|"]
    for row in rows:
        ratio = "" if row.ratio is None else number(row.ratio)
        held = {True: "holds", False: "**not reached**", None: ""}[row.holds]
        cells = (row.name, number(row.value), row.unit, ratio, row.reference, row.goal, held)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def number(value: float) -> str:
    """Format with three significant digits."""
    if value == 0 or abs(value) >= 100:
        return f"{value:,.0f}"
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}"
