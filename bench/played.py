"""The command line of a bench whose robots are played by a process of its own."""

import argparse
import os
from collections.abc import Callable, Iterable


def run_played(about: str | None, rows: Callable[[float], Iterable[str]], play: Callable[[str], None]) -> None:
    """Print the ``rows`` of measurements that take so many seconds each; with ``--play`` be the robots instead."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--seconds", type=float, default=4.0, help="of each measurement")
    parser.add_argument("--play", metavar="ENDPOINT", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.play:
        play(asked.play)
        return
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    for row in rows(asked.seconds):
        print(row)
