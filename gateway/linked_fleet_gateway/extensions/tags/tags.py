"""The tags of a robot: a setting that all gateways share, and its property."""

import logging
from collections.abc import Iterator, Sequence
from functools import lru_cache

import msgspec
from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.api import Body, Graph, Property, Robot, UnprocessableContent
from linked_fleet_gateway.faces import Measurement, Setting
from linked_fleet_rdf.vocabulary import HYBRIT
from linked_fleet_rdf.vocabulary import LF as CORE

LF = CORE.extended("Tags TagsShape TagsInput tags tag")
TAGS = "tags"
MOST_CHARACTERS = 40
log = logging.getLogger(__name__)


def tags_of(robot: Robot) -> Sequence[str]:
    """Return the tags of a robot in their order."""
    record = robot.settings.get(TAGS)
    return () if record is None else _decoded(robot.name, record)


def read_tags(body: Body) -> str:
    """Return the setting that a body describes. Raises UnprocessableContent."""
    said = [each.object for each in body.triples if each.subject == body.root and each.predicate == LF.tag]
    found = {each.value.strip() for each in said if isinstance(each, Literal)}
    for each in found:
        if not each or len(each) > MOST_CHARACTERS or "," in each or not each.isprintable():
            says = f"A tag has 1 to {MOST_CHARACTERS} characters, and no comma, such as hall 3. {each[:60]!r} is none."
            raise UnprocessableContent(says)
    return msgspec.json.encode(sorted(found)).decode()


def tags(robot: Robot) -> Property:
    """Return the property ``tags`` of a robot."""

    def describe(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        graph.add(iri, LF.tag, *map(Literal, tags_of(robot)))
        graph.add(iri, HYBRIT.consumes, LF.TagsInput)

    setting = Setting(robot, TAGS, LF.TagsInput, read_tags, removable=True, heeds_lease=False)
    return Property(TAGS, LF.tags, (LF.Tags,), LF.TagsShape, f"tags of {robot.name}", describe, put=setting)


def introduction(robot: Robot) -> Iterator[tuple[NamedNode, Literal]]:
    """Yield the tags of a robot, for the list of robots."""
    for each in tags_of(robot):
        yield LF.tag, Literal(each)


@lru_cache(maxsize=4096)
def _decoded(robot: str, record: str) -> tuple[str, ...]:
    try:
        return msgspec.json.decode(record, type=tuple[str, ...])
    except ValueError:
        log.error("the tags of %s cannot be read: %.200r", robot, record)  # once, because the result is kept
        return ()
