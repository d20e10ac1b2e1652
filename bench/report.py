"""The results of a run as text, JSON, pictures and in docs/SPEED.md, which has no other source."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.plots import bars
from bench.table import Row, markdown

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "bench/results/latest.json"
PAGE = ROOT / "docs/SPEED.md"
BEGIN, END = "<!-- figures of the last run -->", "<!-- end of the figures -->"
NETWORKS = ("transports", "links")


def result(
    machine: Mapping[str, Any], found: Mapping[str, Sequence[Row]], skipped: Mapping[str, str]
) -> dict[str, Any]:
    """Return the result as stored: rows in the order of the suites, each with the name of its suite."""
    rows = [{"suite": suite, **row._asdict()} for suite, rows in found.items() for row in rows]
    return {**machine, "skipped": dict(skipped), "rows": rows}


def of_suites(said: Mapping[str, Any]) -> dict[str, list[Row]]:
    suites: dict[str, list[Row]] = {}
    for row in said["rows"]:
        suites.setdefault(row["suite"], []).append(Row(*(row[name] for name in Row._fields)))
    return suites


def text(said: Mapping[str, Any]) -> str:
    """Return the table and the machine, in Markdown."""
    rows = [row for rows in of_suites(said).values() for row in rows]
    goals = [row.holds for row in rows if row.holds is not None]
    lines = [
        f"{said['at']}, commit {said['commit']}: {said['processor']}, {said['processors']} processors, "
        f"{said['memory GiB']} GiB, Linux {said['kernel']}, load before {said['load before']:g}. "
        f"Median of {said['runs']} runs, {said['seconds']:g} s each measurement. "
        f"{sum(goals)} of {len(goals)} goals reached.",
        ", ".join(f"{name} {version}" for name, version in said["versions"].items()) + ".",
        markdown(rows),
        *(f"Not measured: {suite}. {reason}" for suite, reason in said["skipped"].items()),
    ]
    return "\n\n".join(lines)


def publish(said: Mapping[str, Any]) -> None:
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(said, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    for path, picture in pictures(said).items():
        path.write_text(picture)
    PAGE.write_text(page(PAGE.read_text(), said))


def page(before: str, said: Mapping[str, Any]) -> str:
    """Return the page with these figures between its marks."""
    begin, _, rest = before.partition(BEGIN)
    return f"{begin}{BEGIN}\n\n{text(said)}\n\n{END}{rest.partition(END)[2]}"


def pictures(said: Mapping[str, Any]) -> dict[Path, str]:
    suites = of_suites(said)
    beside = [row for suite, rows in suites.items() if suite not in NETWORKS for row in rows if row.ratio is not None]
    network = [row for suite in NETWORKS for row in suites.get(suite, [])]
    network.sort(key=lambda row: row.name.partition(", ")[2])  # so that rows to be compared are adjacent
    title = "Through a network of 10 ms each way: ms"
    return {
        ROOT / "docs/speed.svg": bars("Ratio to what was measured beside it", beside, [row.ratio for row in beside]),
        ROOT / "docs/transports.svg": bars(title, network, [row.value for row in network]),
    }
