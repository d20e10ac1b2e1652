"""Runs a module whose wall clock a test can set: FILE -m MODULE ARGUMENTS; the file holds the seconds it is ahead.

``time.time`` and ``time.time_ns`` alone are stepped: monotonic clocks never jump on a real machine either.
"""

import runpy
import sys
import time
from pathlib import Path


def main(file: str, _: str, module: str, *arguments: str) -> None:
    ahead, true_ns = Path(file), time.time_ns

    def stepped_ns() -> int:
        return true_ns() + int(float(ahead.read_text()) * 1e9)

    time.time_ns = stepped_ns
    time.time = lambda: stepped_ns() / 1e9
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
