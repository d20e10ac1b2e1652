"""Invitations: links by which people without a token see the fleet as guests, until they expire or are revoked.

Redis keeps the hash of the token in a link alone, so that nobody can show a link again. The token is none of the file
of identities: it begins a session in a browser, and authenticates no program.
"""

import re
import secrets
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from hashlib import sha256
from hmac import compare_digest
from typing import ClassVar

from msgspec import Struct
from pyoxigraph import Triple

from linked_fleet_base.errors import InsufficientScope
from linked_fleet_gateway.api import (
    DCTERMS,
    Body,
    Container,
    FleetBranch,
    Found,
    Graph,
    Literal,
    Member,
    NamedNode,
    Request,
    RequestView,
    Resource,
    Response,
    Right,
    Table,
    UnprocessableContent,
    body_type,
    timestamp,
)
from linked_fleet_gateway.faces import Identity, TokenHash, form_of, validate_body
from linked_fleet_gateway.serving import BadToken, check_acceptable, convert_body, created_response, parse_form
from linked_fleet_rdf.serialise import JSON, TEXT_TYPES
from linked_fleet_rdf.vocabulary import HYBRIT
from linked_fleet_rdf.vocabulary import LF as CORE

LF = CORE.extended("Invitations Invitation InvitationInput invitationLink invitedBy")
SEGMENT = "invitations"
PATH = "/" + SEGMENT
LINK_PATH = "/login/invitation"
MOST = 100
MOST_DAYS = 30
KEPT_NS = 7 * 86_400 * 1_000_000_000
"""Time for which an expired invitation is listed."""
_MOST_NS = MOST_DAYS * 86_400 * 1_000_000_000
_TOKEN_BYTES = 32
_TOKEN = re.compile(r"lfi_[A-Za-z0-9_-]{43}", re.ASCII)
_RIGHTS = (Right.ADMIN,)
_BODY_TYPES = (*TEXT_TYPES, JSON)


class Invitation(Struct, frozen=True):
    """An invitation. ``sha256`` is the hash of its token, ``by`` who has made it; times are wall nanoseconds."""

    title: str
    until_ns: int
    sha256: str = ""
    by: str = ""
    created_ns: int = 0

    @property
    def guest(self) -> Identity:
        """The identity of those who open the link: they read, and have no other right."""
        return Identity.reader(f"guest of {self.by}", self.until_ns, TokenHash(self.sha256))


@dataclass(frozen=True)
class Invite:
    """Make an invitation."""

    methods: ClassVar[tuple[str, ...]] = ("POST",)
    body_types: ClassVar[tuple[str, ...]] = _BODY_TYPES
    needs: ClassVar[tuple[Right, ...]] = _RIGHTS
    reading: ClassVar[tuple[Right, ...]] = _RIGHTS
    reads: ClassVar[bool] = False


class Invitations:
    """The invitations of a fleet, by the hashes of their tokens."""

    def __init__(self, records: Table[Invitation], opened: Callable[[str, Invitation], None]) -> None:
        self._records, self.opened = records, opened

    def guest(self, credential: TokenHash) -> Identity | None:
        """Return the identity of a guest; None if the invitation was revoked. It may have expired."""
        return next((each.guest for each in self._records.known.values() if each.sha256 == credential.sha256), None)

    def find(self, token: str, now_ns: int) -> tuple[str, Invitation]:
        """Return the invitation of a link, with its id. Raises BadToken with a sentence if it is not valid now."""
        digest = hash_of(token) if _TOKEN.fullmatch(token) else ""
        found = [(id, each) for id, each in self._records.known.items() if compare_digest(each.sha256, digest)]
        if not digest or not found:
            raise BadToken("there is no such invitation, or it was revoked")
        id, invitation = found[0]
        if invitation.until_ns <= now_ns:
            ended = datetime.fromtimestamp(invitation.until_ns // 1_000_000_000, UTC)
            raise BadToken(f"this invitation ended at {ended:%Y-%m-%d %H:%M} UTC")
        return id, invitation

    async def forget_expired(self) -> None:
        """Remove those that expired long ago. Raises RedisUnavailable."""
        now_ns = time.time_ns()
        for id, each in list(self._records.known.items()):
            if each.until_ns + KEPT_NS <= now_ns:
                await self._records.change(id, None)


def hash_of(token: str) -> str:
    return sha256(token.encode()).hexdigest()


# -- as resources -----------------------------------------------------------------------------------------------------


def container_of(records: Table[Invitation]) -> Container[Invitation]:
    return Container(
        segment=SEGMENT, title="Invitations", type=LF.Invitations, member_type=LF.Invitation, records=records,
        shape=LF.InvitationInput, read=read_invitation, describe=_describe, title_of=lambda each: each.title,
        writing=_RIGHTS, reading=_RIGHTS, by_clients=False,
    )  # fmt: skip


def branch_of(container: Container[Invitation]) -> FleetBranch:
    """Return the branch of the container, to which clients post, and from which they delete."""
    branch = container.branch

    def resolve(view: RequestView, rest: list[str]) -> Found:
        found = branch.resolve(view, rest)
        if rest or not isinstance(found, Resource):
            return found

        def consumes(graph: Graph) -> None:
            graph.add(view.iri(PATH), HYBRIT.consumes, LF.InvitationInput)
            for step in found.own_steps(graph):
                assert step is None

        return found.replace(describe=consumes, affords=Invite())

    return replace(branch, resolve=resolve, reading=_RIGHTS, graphs=None)


def invite(container: Container[Invitation]) -> Callable[[Request, Invite], Awaitable[Response]]:
    """Return the handler of POST: the answer alone has the link."""

    async def handle(request: Request, afforded: Invite) -> Response:
        check_acceptable(request)
        if not request.caller.visible_robots.includes_all:
            raise InsufficientScope("Guests read all robots; to invite takes the right to do so.", scope=Right.READ)
        media_type, iri = body_type(request, _BODY_TYPES), request.base + PATH
        form = partial(form_of, LF.InvitationInput)

        def read(content: bytes) -> Body:
            triples: list[Triple] = parse_form(content, media_type, iri, request.base, form)
            return validate_body(triples, LF.InvitationInput, iri)

        invitation = read_invitation(await convert_body(request, read))
        token = "lfi_" + secrets.token_urlsafe(_TOKEN_BYTES)
        by, now_ns = request.caller_name, time.time_ns()
        made = Invitation(invitation.title, invitation.until_ns, hash_of(token), by, now_ns)
        id = await container.records.add(made)
        member = Member(container, request.tree().view, id, made)

        def describe(graph: Graph) -> None:
            member.describe(graph)
            graph.add(member.iri, LF.invitationLink, NamedNode(f"{request.base}{LINK_PATH}?token={token}"))

        return created_response(request, Resource(member.path, member.title, describe))

    return handle


def read_invitation(body: Body) -> Invitation:
    """Return what a body asks for. Raises UnprocessableContent."""
    title, text = body.text(body.root, DCTERMS.title) or "", body.text(body.root, LF.expires) or ""
    try:
        until = datetime.fromisoformat(text)
        until_ns = int(until.timestamp()) * 1_000_000_000
    except (ValueError, OverflowError):
        until = datetime.min
        until_ns = 0
    if until.tzinfo is None or not time.time_ns() < until_ns <= time.time_ns() + _MOST_NS:
        raise UnprocessableContent(
            f"An invitation ends within {MOST_DAYS} days: expires is a time with its zone, such as"
            f" 2026-11-30T18:00:00Z, that is not over, and not {text[:40]!r}."
        )
    return Invitation(title, until_ns)


def _describe(graph: Graph, member: Member[Invitation]) -> None:
    graph.add(member.iri, LF.expires, timestamp(member.record.until_ns))
    graph.add(member.iri, LF.invitedBy, Literal(member.record.by))
    graph.add(member.iri, DCTERMS.created, timestamp(member.record.created_ns))
