"""``python -m mutation``: changes each target in many small ways, one at a time, and expects its tests to fail.

targets.toml names targets and tests. survivors.txt has a row for each mutant that may survive: place, before, after,
reason. Exits with 1 if another one survives, or if a row explains one that does not.
"""

import argparse
import os
import random
import re
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mutation.mutants import Mutant, mutants
from mutation.trial import Outcome, Trials

ROOT = Path(__file__).parents[2]
SEED = 1
_ROW = re.compile(r"^\| (`.+` \| `.+` \| `.+`) \| .+ \|$", re.M)


def main() -> int:
    targets = tomllib.loads(Path(__file__).with_name("targets.toml").read_text())
    parser = argparse.ArgumentParser(prog="mutation", description="Change the code, and expect its tests to fail.")
    parser.add_argument("--only", choices=targets, help="one target")
    parser.add_argument("--at", default="", help="only mutants whose place has this in it, as compiled_data.number")
    parser.add_argument("--all", action="store_true", help="all mutants of a target that has a sample tried")
    told = parser.parse_args()
    os.chdir(ROOT)
    explained = set(_ROW.findall(Path(__file__).with_name("survivors.txt").read_text()))
    print(f"{'target':<10}{'mutants':>12}{'killed':>9}{'timeouts':>9}{'survive':>9}{'seconds':>9}", flush=True)
    bad = 0
    for name, target in targets.items():
        if told.only in (None, name):
            found = [each for file in target["modules"] for each in mutants(ROOT, file) if told.at in each.change[0]]
            most = len(found) if told.all else min(target.get("sample", len(found)), len(found))
            tried = found if most == len(found) else random.Random(SEED).sample(found, most)
            survivors = _try(name, target, tried, len(found), explained)
            killed = {row(mutant) for mutant in tried} - survivors
            of_target = tuple(f"`{Path(file).stem}." for file in target["modules"])
            about = {each for each in explained if each.startswith(of_target)}
            stale = about & killed if told.at or most < len(found) else about - survivors
            for each in sorted(stale):
                print(f"explained, but there is none that survives: | {each} |")
            bad += len(survivors - explained) + len(stale)
    return 1 if bad else 0


def _try(name: str, target: Mapping[str, Any], tried: Sequence[Mutant], among: int, explained: set[str]) -> set[str]:
    """Return the rows of the survivors; prints the unexplained ones, and a line with the figures."""
    began = time.monotonic()
    trials, outcomes, survivors = Trials(ROOT, target), Counter[Outcome](), set[str]()
    for mutant in tried:
        outcome = trials.outcome(mutant)
        outcomes[outcome] += 1
        if outcome is Outcome.SURVIVED:
            survivors.add(row(mutant))
            if row(mutant) not in explained:
                print(f"survives: | {row(mutant)} | |", flush=True)
    figures = "".join(f"{outcomes[each]:>9}" for each in Outcome)
    of = f"{len(tried)} of {among}" if len(tried) < among else f"{among}"
    print(f"{name:<10}{of:>12}{figures}{time.monotonic() - began:>9.0f}", flush=True)
    return survivors


def row(mutant: Mutant) -> str:
    """Return the first cells of the mutant's row in survivors.txt."""
    return " | ".join(f"`{each.replace('|', chr(92) + '|')}`" for each in mutant.change)


if __name__ == "__main__":
    sys.exit(main())
