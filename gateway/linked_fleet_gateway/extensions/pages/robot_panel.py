"""Commands on the page of a robot: sliders, named poses, reach, the control lease, camera pictures."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from pyoxigraph import BlankNode, NamedNode

from linked_fleet_gateway.extensions.pages.values import Facts, Link
from linked_fleet_gateway.extensions.pages.views import LF
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT

_MOVE, _REACH = "/moveJoints", "/reach"
_UNITS_OF_POSITION = frozenset({"rad", "m"})


@dataclass(frozen=True)
class Pose:
    """A named pose, for `scripts/src/poses.js`.

    ``targets`` is JSON: positions in rad or m by the IRI of the joint; empty if ``iri`` is a resource that has them.
    """

    name: str
    targets: str
    iri: str = ""


@dataclass(frozen=True)
class Panel:
    """IRIs of actions and resources, empty where the robot has none."""

    move: str
    reach: str
    lease: str
    cameras: str
    history: str
    teach: str
    notes: str
    poses: Sequence[Pose]


def panel(facts: Facts, iri: NamedNode) -> Panel:
    actions = [each.value for each in facts.nodes(iri, HYBRIT.action)]
    return Panel(
        move=next((each for each in actions if each.endswith(_MOVE)), ""),
        reach=next((each for each in actions if each.endswith(_REACH)), ""),
        lease=facts.iri_of(iri, LF.lease),
        cameras=facts.iri_of(iri, LF.cameras),
        history=facts.iri_of(iri, LF.history),
        teach=facts.iri_of(iri, LF.savedPoses),
        notes=facts.iri_of(iri, LF.notesOfRobot),
        poses=list(_poses(facts, iri)),
    )


def other_actions(actions: Sequence[Link], own: Panel) -> list[Link]:
    """Return the actions for which the panel has no form of its own."""
    return [each for each in actions if each.iri not in (own.move, own.reach)]


def _poses(facts: Facts, iri: NamedNode) -> Iterator[Pose]:
    """Yield the poses that actions of the robot take."""
    for each in facts.all(iri, LF.namedPose):
        if isinstance(each, BlankNode):
            yield Pose(facts.text(each, DCTERMS.title), json.dumps(_targets(facts, each)))
        elif isinstance(each, NamedNode) and facts.one(each, LF.finding) is None:
            yield Pose(facts.text(each, DCTERMS.title), "", each.value)


def _targets(facts: Facts, pose: BlankNode) -> Mapping[str, float]:
    found = {}
    for each in facts.all(pose, LF.target):
        joint, number = facts.one(each, LF.ofJoint), facts.scalar(each, None)
        if isinstance(joint, NamedNode) and number.value and number.name in _UNITS_OF_POSITION:
            found[joint.value] = float(number.value)
    return found
