"""Straight lines of five arms from random places to random places near them: how far the tip leaves the line."""

import argparse
import math

import numpy as np

from bench.planning import quiet
from bench.planning_scenes import ARMS, Scene, arm
from bench.table import Row, bounded, known, markdown, percentile
from linked_fleet_gateway.extensions.planning.messages import FindStraight, LineEnds, StraightFound
from linked_fleet_gateway.extensions.planning.straight import MOST_OFF_M, MOST_OFF_RAD, find_straight
from linked_fleet_gateway.extensions.world.messages import PathSegment

LINES = 1_000
_TURN_RAD = 0.25
"""Standard deviation of the joints between both ends of a line."""


def rows(_: float, lines: int = LINES) -> list[Row]:
    found, ended = list[StraightFound](), 0
    for name in ARMS:
        it, chance = arm(name), np.random.default_rng([3, list(ARMS).index(name)])
        for _ in range(lines // len(ARMS)):
            start = it.somewhere(chance)
            goal = {joint: value + chance.normal(scale=_TURN_RAD) for joint, value in start.items()}
            bounds = {joint: it.bounds(joint, start[joint], goal[joint]) for joint in it.joints}
            tip = it.robot.tree.joints[it.joints[-1]].child
            around = Scene(it, 0, "", (), start, goal).around((PathSegment(goal),))
            with quiet():
                answer = find_straight(FindStraight(around, bounds, tip, goal, turns=True, exact=False), it.robot)
            found += [answer] if isinstance(answer, StraightFound) else []
            ended += isinstance(answer, LineEnds)
    others = lines // len(ARMS) * len(ARMS) - len(found) - ended
    return [
        known("straight lines that arms can follow", "lines", len(found)),
        known("straight lines that leave what the joints can do", "lines", ended),
        bounded("straight lines without a motion for another reason", "lines", others, 0),
        known("deviation from the line, p99", "mm", 1e3 * percentile([each.off_m for each in found], 0.99)),
        bounded("deviation from the line, largest", "mm", 1e3 * max(each.off_m for each in found), 1e3 * MOST_OFF_M),
        bounded(
            "deviation of the orientation, largest",
            "°",
            math.degrees(max(each.off_rad for each in found)),
            math.degrees(MOST_OFF_RAD),
        ),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.straight_lines", description=__doc__)
    parser.add_argument("--lines", type=int, default=LINES)
    print(markdown(rows(0.0, parser.parse_args().lines)))


if __name__ == "__main__":
    main()
