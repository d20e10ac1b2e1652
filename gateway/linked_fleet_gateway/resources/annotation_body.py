"""Annotations in a request body, converted to their stored form."""

import re
from collections.abc import Sequence

from pyoxigraph import NamedNode, RdfFormat, Triple, serialize

from linked_fleet_gateway.base.errors import UnprocessableContent
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.unused import refuse, subjects
from linked_fleet_gateway.rdf.validation import check_writable
from linked_fleet_gateway.resources.annotations import about, beyond, is_own, of_agent
from linked_fleet_gateway.resources.named_poses import read_poses
from linked_fleet_gateway.resources.paths import robot_path

MAX_ANNOTATIONS = 65_536  # characters, as in the wire protocol
# matches N-Triples terms, so that IRIs within literals are left alone
_TERM = re.compile(r'"(?:[^"\\]++|\\.)*+"|<[^>]*>')


def read_annotations(
    triples: Sequence[Triple], robot: Robot, base: str, iri: str, present: frozenset[Triple] = frozenset()
) -> str:
    """Return the statements that are not the agent's, with IRIs relative to the fleet, valid under every base URL.

    ``present`` describes the resource ``iri`` as it is. Raises UnprocessableContent for terms reserved for the gateway,
    and for statements that are not connected to the robot.
    """
    path, constraint = robot_path(robot.name), f"{iri}/blueprint"
    subject = NamedNode(base + path)
    said = about(subjects(triples), subject, subject.value)
    check_writable(said, constraint)
    own = [triple.predicate.value for triple in said if is_own(triple, subject.value)]
    if own:
        raise UnprocessableContent(
            f"Only the gateway says <{own[0][:200]}> of a robot; annotations speak in other vocabularies.",
            constraint=constraint,
        )
    heard = present.union(said)
    refuse(
        [triple for triple in dict.fromkeys(triples) if triple not in heard], constraint,
        f"Annotations are about <{subject.value}>, and about blank nodes and resources outside the fleet that its"
        " statements lead to; nothing uses",
    )  # fmt: skip
    mine = about(beyond(subjects(said), of_agent(robot.annotations, subject.value)), subject, subject.value)
    written = serialize(mine, format=RdfFormat.N_TRIPLES)
    assert written is not None  # nothing is written to a file
    text = _TERM.sub(lambda term: _relative(term[0], base, path), written.decode())
    if len(text) > MAX_ANNOTATIONS:
        raise UnprocessableContent(
            f"The annotations have {len(text)} characters; {MAX_ANNOTATIONS} are the most.", constraint=constraint
        )
    _check_poses(text, robot, constraint)
    return text


def agents_part(described: Sequence[Triple], robot: Robot, base: str, iri: str) -> list[Triple]:
    """Return the triples in the description of ``iri`` that clients do not own: its own and the agent's."""
    subject = NamedNode(base + robot_path(robot.name))
    agents = set(about(of_agent(robot.annotations, subject.value), subject, subject.value))
    return [triple for triple in described if triple in agents or triple.subject == NamedNode(iri)]


def _check_poses(text: str, robot: Robot, constraint: str) -> None:
    """Refuse a pose whose title the robot's agent already uses."""
    taken = sorted(read_poses(text).keys() & read_poses(robot.annotations[0]).keys())
    if taken:
        raise UnprocessableContent(
            f"The robot itself names a pose {taken[0]!r}; give another one another title.", constraint=constraint
        )


def _relative(term: str, base: str, path: str) -> str:
    """Return an IRI below the robot as relative, one elsewhere in the fleet by its path, other terms unchanged."""
    if term.startswith(f"<{base}{path}"):
        return f"<./{term.removeprefix(f'<{base}{path}')}"
    return f"<{term.removeprefix(f'<{base}')}" if re.match(f"<{re.escape(base)}/(?!/)", term) else term
