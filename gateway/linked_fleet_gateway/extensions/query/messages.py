"""Messages between the gateway and its query process: MessagePack with a length prefix, one socket per query.

The process also gets the contributions of the gateway's extensions, so that it resolves the same tree.
"""

import logging
from collections.abc import Iterable, Iterator
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, Literal

import msgspec
from msgspec import Struct

from linked_fleet_base.contributions import Contributions, present
from linked_fleet_gateway.faces import Reader
from linked_fleet_state.answers import DescriptionAndComponents
from linked_fleet_state.carried import CarriedPose
from linked_fleet_state.invocation import Invocation, Lease
from linked_fleet_state.model import Pose
from linked_fleet_state.robot import KeptPose
from linked_fleet_state.unchecked import UncheckedLink

log = logging.getLogger(__name__)

Member = tuple[str, str]
"""Predicate and path of a statement that a branch adds."""
Kind = Literal["rows", "graph", "page"]


class RobotFacts(Struct, frozen=True, kw_only=True):
    """All facts about a robot except its frame, with the meaning they have in ``linked_fleet_state.robot``."""

    name: str
    online: bool
    incarnation: int | None
    description: DescriptionAndComponents | None
    fault: str | None
    limit_fault: str | None
    agent_fault: str
    sensor_faults: dict[str, str]
    unchecked: tuple[UncheckedLink, ...]
    last_seen_ns: int | None
    lease: Lease | None
    settings: dict[str, str]
    targets: dict[str, float]
    branches: list[Member]
    invocations: list[Invocation]
    copier: str = ""
    """The class (``module:name``) that copies parts beside joints and links; empty if there are none."""
    findings: tuple[str, ...] = ()
    kept_poses: dict[str, KeptPose] = {}


Measured = tuple[float, float, float]
"""Position (rad or m), velocity and effort of a joint."""


class HypotheticalRobot(Struct, frozen=True, kw_only=True):
    """A robot in a hypothetical state: values of joints, targets, and motions by id.

    None stands for a target or a motion that does not exist.
    """

    robot: str
    joints: dict[str, Measured]
    targets: dict[str, float | None]
    motions: dict[str, Invocation | None]


class News(Struct, frozen=True, kw_only=True):
    """Changes since the previous query: robots, and frames by robot (None for a robot without one).

    ``values`` are those of parts beside joints and links, by robot. ``forgotten`` are robots that the fleet no longer
    has.
    """

    robots: list[RobotFacts]
    frames: dict[str, bytes | None]
    forgotten: list[str] = []
    values: dict[str, bytes] = {}


class QueryRequest(Struct, frozen=True, kw_only=True):
    """One query on the present snapshot for a caller who sees the robots of ``patterns``.

    ``base`` is scheme and authority of all IRIs, ``base_iri`` the base of relative ones in the query. ``default`` and
    ``named`` are the requested graphs, None for all. ``invocations`` are those of the whole fleet. ``graphs`` are
    N-Triples by the path of the graph that they are added to. ``bindings`` is a solution in JSON results form,
    ``media_type`` that of the answer. ``poses`` are those of things besides robots in the common frame, by path,
    and ``carried`` those on links of robots. ``hypothetical_robots`` replace the state of robots.
    """

    news: News
    query: str
    navigation: list[tuple[str, str, int, bool, bool]] = []
    """Navigation entries of extensions on result pages: title, path, rank, and for whom they are."""
    reader: Reader = Reader()
    base: str
    base_iri: str
    patterns: tuple[str, ...]
    caller: str
    default: tuple[str, ...] | None
    named: tuple[str, ...] | None
    branches: list[Member]
    invocations: list[Invocation]
    graphs: list[tuple[str, bytes]]
    media_type: str
    most_bytes: int
    limit_s: float
    bindings: dict[str, dict[str, str]] = {}
    poses: dict[str, Pose] = {}
    carried: dict[str, CarriedPose] = {}
    hypothetical_robots: tuple[HypotheticalRobot, ...] = ()
    only_check: bool = False


class Refusal(Struct, frozen=True, kw_only=True):
    """The reason for having no result: the query is ``wrong``, its result too ``large``, the evaluation ``failed``, or
    a library that it needs is ``missing``.
    """

    reason: Literal["wrong", "large", "failed", "missing"]
    detail: str
    line: int | None = None
    column: int | None = None


class Refused(Exception):  # noqa: N818 - named for the outcome
    """The query has no result; the refusal gives the reason."""

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.detail)
        self.refusal = refusal


def size_refusal(most_bytes: int) -> Refusal:
    detail = f"The result has more than {most_bytes} bytes. Select less, aggregate, or use LIMIT and OFFSET."
    return Refusal(reason="large", detail=detail)


FORKED, DONE, REFUSED = b"f", b"d", b"r"
"""The first byte sent means that the query has started; the last says if the bytes between are a result or a
``Refusal``.
"""

PATIENCE = 4
"""Ratio of wall time to processor time that a query may take, on a machine with other load."""

_encode = msgspec.msgpack.Encoder().encode
_ask = msgspec.msgpack.Decoder(QueryRequest)
_refusal = msgspec.msgpack.Decoder(Refusal)


def encode(message: QueryRequest | Refusal) -> bytes:
    return _encode(message)


def decode_ask(content: bytes) -> QueryRequest:
    return _ask.decode(content)


def decode_refusal(content: bytes) -> Refusal:
    """Decode a refusal. Raises ValidationError."""
    return _refusal.decode(content)


class NamedContributions(msgspec.Struct):
    """Reserved segments, Turtle files, and ``module:attribute`` names of other contributions."""

    at_root: list[str]
    in_robot: list[str]
    files: dict[str, list[str]]
    robot_properties: list[str]
    link_statements: list[str]
    introductions: list[str]
    functions: list[str]
    placements: list[str]


def contributions() -> str:
    """Return the contributions in this process as an argument of the query process."""
    found = present()
    known = NamedContributions(
        sorted(found.at_root),
        sorted(found.in_robot),
        {name: [str(each) for each in files] for name, files in found.files.items()},
        _names(found.robot_properties),
        _names(found.link_statements),
        _names(found.introductions),
        _names(found.functions),
        _names(found.placements),
    )
    return msgspec.json.encode(known).decode()


def _names(objects: Iterable[Any]) -> list[str]:
    return [name_of(each) for each in objects]


def name_of(each: Any) -> str:
    """Return the name by which the query process finds a function or class."""
    return f"{each.__module__}:{each.__qualname__}"


def decode_contributions(text: str) -> Contributions:
    """Return the same contributions in this process. What cannot be imported is logged and left out."""
    said = msgspec.json.decode(text, type=NamedContributions)
    return Contributions(
        at_root=frozenset(said.at_root),
        in_robot=frozenset(said.in_robot),
        files={name: tuple(map(Path, files)) for name, files in said.files.items()},
        robot_properties=tuple(_resolved(said.robot_properties)),
        link_statements=tuple(_resolved(said.link_statements)),
        introductions=tuple(_resolved(said.introductions)),
        functions=tuple(_resolved(said.functions)),
        placements=tuple(_resolved(said.placements)),
    )


def _resolved(names: Iterable[str]) -> Iterator[Any]:
    for name in names:
        try:
            yield resolve_name(name)
        except Exception:  # whatever a foreign module raises must not hide the objects of others
            log.exception("%s of an extension cannot be imported and is left out", name)
