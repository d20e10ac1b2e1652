"""All benchmarks in one table: ``make bench``. bench/README.md says how to read it."""

import argparse
import contextlib
import importlib
import sys
import time
import traceback
from collections.abc import Sequence
from typing import NamedTuple

from bench.machine import machine
from bench.report import publish, result, text
from bench.table import Row, UnavailableError, median


class Suite(NamedTuple):
    """A module ``bench.NAME`` and how many times its ``rows(seconds)`` runs; once if it is slow and varies little."""

    name: str
    repeated: bool = True


SUITES = (
    Suite("start", repeated=False),
    Suite("answers"),
    Suite("containers"),
    Suite("encodings", repeated=False),
    Suite("large", repeated=False),
    Suite("fan_out"),
    Suite("ingest"),
    Suite("footprint", repeated=False),
    Suite("joining", repeated=False),
    Suite("components", repeated=False),
    Suite("latency"),
    Suite("driving"),
    Suite("driven_fleet", repeated=False),
    Suite("ways", repeated=False),
    Suite("planning", repeated=False),
    Suite("ros2", repeated=False),
    Suite("actions", repeated=False),
    Suite("parts", repeated=False),
    Suite("binary", repeated=False),
    Suite("transports"),
    Suite("links"),
    Suite("memory", repeated=False),
    Suite("history", repeated=False),
    Suite("pages", repeated=False),
    Suite("peers", repeated=False),
)


def main() -> int:
    """Return exit code 1 if a suite failed; the other figures are printed anyway."""
    arguments = _parser().parse_args()
    suites = [suite for suite in SUITES if not arguments.only or suite.name in arguments.only]
    about = {**machine(), "seconds": arguments.seconds, "runs": arguments.runs}
    found, skipped, failed = dict[str, list[Row]](), dict[str, str](), list[str]()
    for suite in suites:
        try:
            found[suite.name] = run(suite, arguments.seconds, arguments.runs)
        except UnavailableError as reason:
            skipped[suite.name] = str(reason)
        except Exception:  # noqa: BLE001 - the other suites are measured anyway
            traceback.print_exc()
            failed.append(suite.name)
    said = result(about, found, skipped)
    print(text(said))
    if failed:
        print(f"failed: {', '.join(failed)}; nothing was written", file=sys.stderr)
    elif not arguments.only:
        publish(said)
    return bool(failed)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("--seconds", type=float, default=1.0, help="of each measurement")
    parser.add_argument("--runs", type=int, default=5, help="of which the median is taken")
    names = [suite.name for suite in SUITES]
    parser.add_argument("--only", nargs="+", choices=names, default=[], help="these alone, and nothing is written")
    return parser


def run(suite: Suite, seconds: float, runs: int) -> list[Row]:
    rows = importlib.import_module(f"bench.{suite.name}").rows
    begin, found = time.monotonic(), list[Sequence[Row]]()
    for _ in range(runs if suite.repeated else 1):
        found.append(rows(seconds))
    print(f"{suite.name}: {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)  # progress
    return median(found)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        sys.exit(main())
