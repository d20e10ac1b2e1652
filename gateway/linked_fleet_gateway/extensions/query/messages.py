"""Messages between the gateway and its query process: MessagePack behind a length, and one socket per query."""

from typing import Literal

import msgspec
from msgspec import Struct

from linked_fleet_agent.wire.messages import Description
from linked_fleet_gateway.fleet.invocation import Invocation
from linked_fleet_gateway.fleet.lease import Lease
from linked_fleet_gateway.fleet.model import Pose

Member = tuple[str, str]
"""Predicate and path of what a branch adds to a description."""
Kind = Literal["rows", "graph", "page"]


class RobotFacts(Struct, frozen=True, kw_only=True):
    """All that is known of a robot but its frame; ``last_seen_ns`` and the rest as ``fleet.robot`` has it."""

    name: str
    online: bool
    incarnation: int | None
    description: Description | None
    fault: str | None
    limit_fault: str | None
    last_seen_ns: int | None
    lease: Lease | None
    settings: dict[str, str]
    targets: dict[str, float]
    branches: list[Member]
    invocations: list[Invocation]


Measured = tuple[float, float, float]
"""Position (rad or m), velocity and effort of a joint."""


class Instead(Struct, frozen=True, kw_only=True):
    """A robot in another state than it is: some of its joints and their targets, and motions by id as they were then;
    None for a target or a motion that there was not."""

    robot: str
    joints: dict[str, Measured]
    targets: dict[str, float | None]
    motions: dict[str, Invocation | None]


class Placed(Struct, frozen=True):
    """An object of the world, as far as its place matters."""

    pose: Pose


class News(Struct, frozen=True, kw_only=True):
    """Changes since the query before: robots, and frames by robot, None for a robot without a frame.

    ``forgotten``: robots that the fleet does not have any more.
    """

    robots: list[RobotFacts]
    frames: dict[str, bytes | None]
    forgotten: list[str] = []


class Ask(Struct, frozen=True, kw_only=True):
    """One query, of the fleet as it is at this instant to one who ``sees`` robots by these patterns.

    ``base`` is scheme and authority of all IRIs, ``base_iri`` what relative ones in the query are resolved against.
    ``default`` and ``named`` are the graphs that were asked for, None for all. ``invocations`` are those of the whole
    fleet. ``graphs``: N-Triples by the path of the graph that they are added to. ``bindings`` is a solution in the
    JSON of results, ``accept`` what the answer may be.
    ``objects`` stand in the world, by id. ``instead``: robots that are supposed to be in another state.
    """

    news: News
    query: str
    navigation: list[tuple[str, str, int]] = []
    """The entries of extensions that a page of results has: title, path and rank."""
    audited: bool = False
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
    objects: dict[str, Placed] = {}
    instead: tuple[Instead, ...] = ()
    only_check: bool = False


class Refusal(Struct, frozen=True, kw_only=True):
    """Why there is no result: whether the query is ``wrong`` or asks for too much."""

    reason: Literal["wrong", "large", "failed"]
    detail: str
    line: int | None = None
    column: int | None = None


class Refused(Exception):  # noqa: N818 - it is what the caller is told
    """There is no result, and why."""

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.detail)
        self.refusal = refusal


def too_large(most_bytes: int) -> Refusal:
    detail = f"The result has more than {most_bytes} bytes. Select less, aggregate, or use LIMIT and OFFSET."
    return Refusal(reason="large", detail=detail)


FORKED, DONE, REFUSED = b"f", b"d", b"r"
"""The first byte that comes says that the query has begun; the last, what came before: a result, or a ``Refusal``."""

PATIENCE = 4
"""How much longer than its processor time a query may last, on a machine that does other things."""

_encode = msgspec.msgpack.Encoder().encode
_ask = msgspec.msgpack.Decoder(Ask)
_refusal = msgspec.msgpack.Decoder(Refusal)


def encode(message: Ask | Refusal) -> bytes:
    return _encode(message)


def decode_ask(content: bytes) -> Ask:
    return _ask.decode(content)


def decode_refusal(content: bytes) -> Refusal:
    """ValidationError for anything else."""
    return _refusal.decode(content)
