"""Constraints of a motion, as its request says them, and the refusal of a motion that breaks one."""

import math

from linked_fleet_gateway.api import Body, Motion, Robot, UnprocessableContent
from linked_fleet_gateway.extensions.planning.errors import BreaksConstraint
from linked_fleet_gateway.extensions.planning.kept_path import above
from linked_fleet_gateway.extensions.planning.messages import Broken, Constraints
from linked_fleet_gateway.extensions.planning.terms import LF
from linked_fleet_gateway.extensions.world.placement import read_vector
from linked_fleet_rdf.graph import Node
from linked_fleet_state.xml import Vector

_OPTIONS = (LF.upright, LF.stayIn, LF.tipSpeed, LF.leastManipulability)


def is_constrained(body: Body) -> bool:
    """Return True if a request has constraints."""
    root = body.root
    return any(body.node(root, each) is not None or body.text(root, each) is not None for each in _OPTIONS)


def constraints_of(motion: Motion) -> Constraints:
    """Return what a motion keeps to; without a tip if it has none and no single link is meant.

    Raises UnprocessableContent.
    """
    assert motion.request is not None
    body, root = motion.request.body, motion.request.body.root
    if not is_constrained(body):
        return Constraints(_tip(motion) if len(_ends(motion)) == 1 else "")
    upright, box, speed = (body.node(root, each) for each in (LF.upright, LF.stayIn, LF.tipSpeed))
    return Constraints(
        _tip(motion),
        None if upright is None else min(body.quantity(upright), math.pi),
        "" if upright is None else body.text(upright, LF.axis) or "",
        None if box is None else _box(body, box),
        None if speed is None else body.quantity(speed),
        body.number(root, LF.leastManipulability) or 0.0,
    )


def _tip(motion: Motion) -> str:
    """Return the link that is meant. Raises UnprocessableContent if the motion does not move it."""
    assert motion.request is not None
    body, model = motion.request.body, motion.request.model()
    named = body.node(body.root, LF.tip) or body.node(body.root, LF.ofLink)
    if named is None:
        return carried(motion)
    link = motion.request.link_at(named)
    joint = model.links[link].parent_joint
    if joint is None or not motion.targets.keys() & {joint, *above(model, joint)}:
        raise UnprocessableContent(f"The motion does not move {link}: lf:tip is a link that its joints carry.")
    return link


def _ends(motion: Motion) -> set[str]:
    """Return the joints of a motion that carry no other one of it."""
    assert motion.robot.model is not None
    below = {each for name in motion.targets for each in above(motion.robot.model, name)}
    return motion.targets.keys() - below


def carried(motion: Motion) -> str:
    """Return the link that the last of the joints of a motion carries. Raises UnprocessableContent without one."""
    model, (last, *others) = motion.robot.model, sorted(_ends(motion))
    assert model is not None
    if others:
        raise UnprocessableContent(
            f"{last} does not carry what {others[0]} carries, so no single link is meant: lf:Straight and constraints "
            "are for joints of one arm."
        )
    return model.joints[last].child


def _box(body: Body, node: Node) -> tuple[Vector, Vector]:
    corners = body.node(node, LF.lower), body.node(node, LF.upper)
    assert corners[0] is not None and corners[1] is not None
    lower, upper = (read_vector(body, each) for each in corners if each is not None)
    for name, low, high in zip("xyz", lower, upper, strict=True):
        if not low < high:
            raise UnprocessableContent(
                f"The box of lf:stayIn has {name} from {low:g} m to {high:g} m: lf:lower is less than lf:upper."
            )
    return lower, upper


def refusal(robot: Robot, tip: str, broken: Broken) -> BreaksConstraint:
    """Return the refusal of a motion that does not keep to a constraint."""
    where = {0.0: "where the motion begins", 1.0: "at its goal"}.get(broken.share)
    where = where or f"after {100 * broken.share:.0f} % of the way"
    what = {"upright": _tilted, "stayIn": _outside, "leastManipulability": _singular}[broken.kind](broken)
    reason = f"{tip} would not keep to lf:{broken.kind}"
    return BreaksConstraint(f"{tip} of {robot.name} {what} {where}.", reason=reason, broken=broken)


def _tilted(broken: Broken) -> str:
    value, limit = (math.degrees(each) for each in (broken.value, broken.limit))
    return f"is not upright: its axis {broken.axis} is {value:.1f}° from the vertical, and may be {limit:.1f}°,"


def _outside(broken: Broken) -> str:
    side, value, limit = "at least" if broken.value < broken.limit else "at most", broken.value, broken.limit
    return f"is outside of its box: {broken.axis} in the world is {value:.3f} m, and may be {side} {limit:.3f} m,"


def _singular(broken: Broken) -> str:
    value, limit = broken.value, broken.limit
    return f"is near a singularity: its manipulability is {value:.2g}, and may be {limit:.2g} at least,"
