"""Turn a joint of one robot as a joint of another robot turns, until Ctrl-C.

Usage: python follow_the_leader.py [URL [LEADER [FOLLOWER]]]

LEADER and FOLLOWER are joints of the fleet at URL, such as ur5/shoulder_pan_joint and panda/panda_joint1.
"""

import sys

from linked_fleet_client.action import Action
from linked_fleet_client.errors import Controlled, ControlLost, Problem
from linked_fleet_client.fleet import Fleet

PERIOD_S = 0.2
SPEED_SCALE = 0.5


def within_limits(rotate: Action, angle: float) -> float:
    """Return the nearest angle that the shape of the action allows, in rad."""
    (value,) = (field for field in rotate.fields if field.name == "value")
    for limits in value.limits:
        if any(str(unit).endswith("RAD") for unit in limits.when.get("unit", ())):
            angle = angle if limits.lower is None else max(angle, limits.lower.value)
            angle = angle if limits.upper is None else min(angle, limits.upper.value)
    return angle


def follow(fleet: Fleet, leader: str, follower: str) -> None:
    """Command the follower after each change of the leader, while nobody else may move it.

    Each motion preempts the one before.
    """
    rotate = fleet.at(follower).actions["rotate"]
    with fleet[follower.partition("/")[0]].control("follow_the_leader"):
        for change in fleet.at(leader).properties["rotation"].subscribe(interval_s=PERIOD_S):
            angle = change.reading.main
            if angle is None or angle.number is None:
                continue  # the position of the leader is unknown
            goal = within_limits(rotate, angle.number)
            try:
                rotate(value=goal, unit="rad", speedScale=SPEED_SCALE)
                print(f"{angle} -> {goal:.3f} rad", flush=True)
            except Problem as problem:  # such as a collision
                print(f"{angle} -> refused: {problem}", flush=True)


def main(url: str = "http://127.0.0.1:8000/", *joints: str) -> None:
    leader, follower = joints or ("ur5/shoulder_pan_joint", "panda/panda_joint1")
    with Fleet(url) as fleet:
        try:
            follow(fleet, leader, follower)
        except KeyboardInterrupt:
            fleet.at(follower).actions["hold"]()
            print("The follower holds.")
        except (Controlled, ControlLost) as error:
            print(f"Somebody else moves the follower: {error}")


if __name__ == "__main__":
    main(*sys.argv[1:])
