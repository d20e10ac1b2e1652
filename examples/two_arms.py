"""A mission for two arms: each picks its part and places it, both at the same time, and then they wait for a person.

Usage: python two_arms.py http://127.0.0.1:8000/ [width of the parts in m]

The demo's grippers close on what somebody puts between their fingers, which its component ``simulation`` does.
"""

import sys
from typing import Any

from linked_fleet_client.fleet import Fleet, Thing

RADIAN = "http://qudt.org/vocab/unit/RAD"


def invoke(thing: Thing, action: str, title: str, **body: Any) -> dict[str, Any]:
    found = thing.actions[action]
    return {"type": "invoke", "action": str(found.iri), "title": title, **({"body": body} if body else {})}


def pick_and_place(robot: Thing, gripper: str, joint: str, pick: float, place: float) -> dict[str, Any]:
    """Return the steps of one arm, which turns one joint between the two places."""
    hand, who, width = robot[gripper], robot.name, {"variable": "width"}
    steps = [
        invoke(hand, "open", f"{who} opens its gripper"),
        invoke(robot[joint], "rotate", f"{who} goes to its part", value=pick, unit=RADIAN),
        invoke(robot["simulation"], "putObject", f"a part comes into the hand of {who}", width=width, gripper=gripper),
        invoke(hand, "grasp", f"{who} grasps it", force=20),
        invoke(robot[joint], "rotate", f"{who} carries it to its place", value=place, unit=RADIAN),
        invoke(hand, "open", f"{who} lets go"),
    ]
    return {"type": "sequence", "title": who, "steps": steps}


def main(url: str, width: float = 0.03) -> int:
    with Fleet(url) as fleet:
        arms = [
            pick_and_place(fleet["panda"], "gripper", "panda_joint1", 0.4, -0.4),
            pick_and_place(fleet["baxter"], "left_fingers", "left_s0", 0.2, -0.2),
        ]
        ask = {"type": "confirm", "title": "Are the parts there?", "text": "Are both parts in their places?"}
        mission = fleet.missions.write(
            {
                "title": "Two arms pick and place",
                "parameters": [{"name": "width", "type": "number", "minimum": 0.01, "maximum": 0.04, "default": 0.03}],
                "step": {"type": "sequence", "steps": [{"type": "parallel", "steps": arms}, ask]},
                "holds": True,  # a step that fails waits for `linked-fleet do`: retry or skip
            }
        )
        run, told = mission.run(width=width), set[tuple[str, str]]()
        for state in run.watch():
            for step in state.steps:
                if (step.title, step.state) in told:
                    continue
                told.add((step.title, step.state))
                print(f"{step.state:10} {step.title}  {step.reason}", flush=True)
                if step.state == "waiting":
                    run.confirm(step.path)  # here a person would look
        return 0 if run.wait() == "succeeded" else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], *map(float, sys.argv[2:])))
