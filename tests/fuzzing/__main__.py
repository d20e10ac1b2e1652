"""``python -m fuzzing`` runs all targets. It prints a line for each, and a command that reproduces each finding."""

import argparse
import importlib
import sys
import time

from fuzzing.findings import Tally

SHARES = {
    "wire": 0.43,
    "components": 0.05,
    "bodies": 0.2,
    "http": 0.12,
    "sockets": 0.02,
    "foxglove": 0.02,
    "robots": 0.05,
    "ros2": 0.05,
    "identities": 0.02,
    "mcp": 0.02,
    "descriptions": 0.02,
}
"""Share of inputs per target: such that each takes about the same time, and more where more can go wrong."""


def run(target: str, count: int, seed: int, first: int = 0) -> Tally:
    """Run the inputs ``first`` to ``first + count`` of a target."""
    tally: Tally = importlib.import_module(f"fuzzing.{target}").run(count, seed, first)
    return tally


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--only", choices=SHARES)
    parser.add_argument("--first", type=int, default=0)
    told = parser.parse_args()
    print(f"seed {told.seed}\n{'target':<10}{'inputs':>10}{'seconds':>10}{'inputs/s':>10}{'findings':>10}", flush=True)
    tallies = []
    for target, share in SHARES.items():
        if told.only in (None, target):
            count = told.count if told.only else round(told.count * share)
            tallies.append(run(target, count, told.seed, told.first))
            print(line(tallies[-1]), flush=True)
    return report(tallies)


def line(tally: Tally) -> str:
    rate = tally.inputs / max(tally.seconds, 1e-9)
    figures = f"{tally.inputs:>10}{tally.seconds:>10.1f}{rate:>10.0f}{len(tally.findings):>10}"
    return f"{tally.target:<10}{figures}   {'; '.join(tally.notes)}"


def report(tallies: list[Tally]) -> int:
    """Print the findings; return the exit status."""
    for tally in tallies:
        for what, finding in tally.findings.items():
            print(f"\n{what} ({tally.repeats[what]} times)\n  {finding.command}\n{finding.detail}")
    total = sum(tally.inputs for tally in tallies)
    bad = sum(len(tally.findings) for tally in tallies)
    print(f"\n{total} inputs, {bad} findings")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
