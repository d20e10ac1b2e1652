"""What clients may set of a robot: title, annotations, maximum speed scale, placement; from a body to the memory."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

from pyoxigraph import BlankNode, NamedNode, RdfFormat, Triple, serialize

from gateway.actions.body import Body
from gateway.errors import UnprocessableContent
from gateway.fleet.robot import Robot
from gateway.graph.annotations import is_own
from gateway.graph.judge import Judge, reachable
from gateway.graph.paths import robot_path
from gateway.graph.shapes import load
from gateway.graph.validation import root
from gateway.graph.vocab import LF, VOM
from gateway.world.placement import PLACEMENT, read_placement

_XML_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*\Z")
MAX_ANNOTATIONS = 65_536  # characters, as on the wire
_TERM = re.compile(r'"(?:[^"\\]++|\\.)*+"|<[^>]*>')  # of N-Triples: what is in a literal is no IRI


@dataclass(frozen=True)
class Setting:
    """One setting of one robot; ``shape`` is what a body must conform to. Annotations have no form: they have none."""

    robot: Robot
    name: str
    shape: NamedNode | None = None
    read: Callable[[Body], str] | None = None
    removable: bool = False
    """Whether clients may take it back, by DELETE."""

    @property
    def path(self) -> str:
        return robot_path(self.robot.name) + self.name

    def admit(self, triples: Sequence[Triple], base: str) -> str:
        """What is to be remembered; UnprocessableContent when the shape refuses the body."""
        if self.shape is None or self.read is None:
            return _annotations(triples, base, robot_path(self.robot.name))
        return self.read(judged(triples, self.shape, base + self.path))


def judged(triples: Sequence[Triple], shape: NamedNode, iri: str) -> Body:
    """A body to be put at ``iri``; UnprocessableContent when the blueprint's shape refuses it."""
    focus = root(triples, NamedNode(iri))
    found = _judge(shape).report(triples, focus, iri)
    if found is not None:
        detail, report = found
        raise UnprocessableContent(
            f"The body does not conform to the blueprint: {detail}", report=report, constraint=f"{iri}/blueprint"
        )
    return Body(triples, focus)


def settings(robot: Robot) -> dict[str, Setting]:
    found = (
        Setting(robot, "title", LF.TextInput, _title),
        Setting(robot, "annotations"),
        Setting(robot, "maximumSpeedScale", LF.SpeedScaleInput, _scale),
        Setting(robot, PLACEMENT, LF.PlacementInput, read_placement, removable=True),
    )
    return {each.name: each for each in found}


@cache
def _judge(shape: NamedNode) -> Judge:
    return Judge([triple for about in load("blueprints.ttl").values() for triple in about], shape)


def _title(body: Body) -> str:
    text = body.text(body.root, LF.value)
    assert text is not None
    return text


def _scale(body: Body) -> str:
    value = body.node(body.root, LF.value)
    assert value is not None
    return repr(body.number(value, VOM.numericalValue))


def _annotations(triples: Sequence[Triple], base: str, path: str) -> str:
    """What is said about the robot, without the authority, so that it holds under every base URL."""
    robot = NamedNode(base + path)
    about = [t for t in reachable(triples, robot) if t.subject == robot or isinstance(t.subject, BlankNode)]
    theirs = [triple.predicate.value for triple in about if is_own(triple)]
    unwritable = [t.predicate.value for t in about if not _XML_NAME.search(t.predicate.value)]
    if unwritable:
        raise UnprocessableContent(
            f"RDF/XML cannot say <{unwritable[0][:200]}>: a predicate ends in a name, such as label or isOwnedBy."
        )
    if theirs:
        raise UnprocessableContent(
            f"Only the gateway says <{theirs[0][:200]}> of a robot; annotations speak in other vocabularies."
        )
    written = serialize(about, format=RdfFormat.N_TRIPLES)
    assert written is not None  # nothing is written to a file
    text = _TERM.sub(lambda term: _relative(term[0], base, path), written.decode())
    if len(text) > MAX_ANNOTATIONS:
        raise UnprocessableContent(f"The annotations have {len(text)} characters; {MAX_ANNOTATIONS} are the most.")
    return text


def _relative(term: str, base: str, path: str) -> str:
    """An IRI below the robot as seen from there, one elsewhere in the fleet by its path, any other term as it is."""
    if term.startswith(f"<{base}{path}"):
        return f"<./{term.removeprefix(f'<{base}{path}')}"
    return f"<{term.removeprefix(f'<{base}')}" if re.match(f"<{re.escape(base)}/(?!/)", term) else term
