"""The guard of a body: the very shape that its action's description links, compiled once (paper 5.4)."""

from collections.abc import Sequence
from functools import lru_cache

from pyoxigraph import NamedNode, Triple

from gateway.actions.body import Body
from gateway.actions.definition import Definition
from gateway.actions.offer import Offer
from gateway.actions.poses import poses
from gateway.errors import UnprocessableContent
from gateway.fleet.model import Joint, RobotModel
from gateway.fleet.robot import Robot
from gateway.graph.build import Graph
from gateway.graph.judge import Judge
from gateway.graph.validation import root
from gateway.graph.vocab import LF


def admit(offer: Offer, triples: Sequence[Triple], base: str) -> Body:
    """The body as its handler reads it; UnprocessableContent with the validation report when the shape refuses it.

    What the shape does not cover is ignored (paper 5.4).
    """
    iri = base + offer.path
    focus = root(triples, NamedNode(iri))
    robot = offer.robot
    model = robot.model if robot is not None else None
    named = tuple(poses(robot)) if robot is not None and offer.definition.iri == LF.AssumePose else ()
    joints = robot.description.joints if robot is not None and robot.description is not None else ()
    judge = _judge(offer.definition, base, offer.thing, robot, offer.joint, model, joints, named)
    report = judge.report(triples, focus, iri)
    if report is not None:
        detail, about = report
        raise UnprocessableContent(
            f"The body does not conform to the shape of the action: {detail}", report=about, constraint=iri
        )
    return Body(triples, focus)


@lru_cache(maxsize=1024)  # five robots have some three hundred actions
def _judge(
    definition: Definition,
    base: str,
    thing: str,
    robot: Robot | None,
    joint: Joint | None,
    model: RobotModel | None,
    joints: tuple[str, ...],
    named: tuple[str, ...],
) -> Judge:
    """What the shape speaks of is in the key: a description may list other joints of the same model, or other poses."""
    graph = Graph()
    shape = Offer(definition, thing, robot, joint).consumes(graph, base)
    return Judge(graph.triples, shape)
