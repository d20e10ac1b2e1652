"""The action by which gateways jog a hand: they add it to the component that jogs joints. Pure."""

from collections.abc import Iterator, Sequence
from importlib.util import find_spec

from msgspec.structs import replace

from linked_fleet_agent.wire.components import Action, Component
from linked_fleet_agent.wire.kinds import LF
from linked_fleet_agent.wire.schema import MAX_CHOICES, Schema
from linked_fleet_state.model import RobotModel

JOGGING, JOG_JOINTS, JOG_HAND = LF + "Jogging", "jogJoints", "jogHand"
FRAMES = ("hand", "root", "world")
MOST_M_S, MOST_RAD_S = 0.5, 1.5
_LEAST_JOINTS = 2
_MOUNTED = (LF + "Gripper", LF + "Switch")
"""Kinds of components that are mounted where the work is done."""


def with_hand(components: Sequence[Component], model: RobotModel) -> list[Component]:
    """Return the components of a robot; the one that jogs joints jogs hands too, if a link can be one."""
    return [_with_hand(each, components, model) if each.semantic_type == JOGGING else each for each in components]


def _with_hand(jogging: Component, all_: Sequence[Component], model: RobotModel) -> Component:
    action = jogging.actions.get(JOG_JOINTS)
    if action is None or action.input is None or JOG_HAND in jogging.actions:
        return jogging
    hands = _hands(model, frozenset(action.moves))
    if not hands or find_spec("pinocchio") is None:
        return jogging
    tool = next((each.link for each in all_ if each.semantic_type in _MOUNTED and each.link in hands), "")
    furthest = max(hands, key=lambda link: hands[link])
    added = _jog_hand(action, list(hands)[:MAX_CHOICES], tool or furthest)
    return replace(jogging, actions={**jogging.actions, JOG_HAND: added})


def _hands(model: RobotModel, jogged: frozenset[str]) -> dict[str, int]:
    """Return the links that jogged joints carry, with the number of these joints."""
    found = dict[str, int]()
    for link in model.links:
        above = list(_above(model, link))
        count = len(jogged.intersection(above))
        if count >= _LEAST_JOINTS and all(model.joints[each].kind not in ("floating", "planar") for each in above):
            found[link] = count
    return found


def _above(model: RobotModel, link: str) -> Iterator[str]:
    while (joint := model.links[link].parent_joint) is not None:
        yield joint
        link = model.joints[joint].parent


def _jog_hand(joints: Action, links: Sequence[str], usual: str) -> Action:
    assert joints.input is not None
    links = [usual, *(each for each in links if each != usual)][:MAX_CHOICES]
    given = Schema(
        type="object",
        properties={
            "linear": _vector("Velocity", "M-PER-SEC", MOST_M_S),
            "angular": _vector("Angular velocity", "RAD-PER-SEC", MOST_RAD_S),
            "frame": Schema(type="string", title="Frame of the axes", enum=FRAMES, default=FRAMES[0]),
            "link": Schema(type="string", title="Link that is moved", enum=tuple(links), default=usual),
            "duration": joints.input.properties["duration"],
        },
    )
    said = (
        "Move a link with a velocity and an angular velocity about its origin for a short time, then brake. The axes"
        " are those of the link itself, of the root of the robot, or of the world."
    )
    return replace(joints, title="Jog hand", description=said, semantic_type=LF + "JogHand", input=given)


def _vector(title: str, unit: str, most: float) -> Schema:
    axis = Schema(type="number", unit=unit, minimum=-most, maximum=most)
    return Schema(type="object", title=title, properties=dict.fromkeys("xyz", axis))
