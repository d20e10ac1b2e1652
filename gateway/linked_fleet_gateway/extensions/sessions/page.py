"""The page of invitations: a form that makes one, and those there are."""

from dataclasses import dataclass
from pathlib import Path

from linked_fleet_gateway.api import DCTERMS, LDP, NamedNode
from linked_fleet_gateway.extensions.pages.api import Facts, Link, PageView, Part, Value
from linked_fleet_gateway.extensions.pages.languages import message
from linked_fleet_gateway.extensions.sessions.invitations import LF, MOST_DAYS


@dataclass(frozen=True)
class Row:
    """An invitation."""

    link: Link
    by: str
    created: Value | None
    until: Value | None


def invitations(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    rows = [
        Row(
            facts.link(each), facts.text(each, LF.invitedBy), facts.first_value(each, DCTERMS.created),
            facts.first_value(each, LF.expires),
        )
        for each in members
    ]  # fmt: skip
    return Part({"rows": rows, "days": MOST_DAYS}, {LDP.contains}, {*members})


VIEW = PageView(
    LF.Invitations,
    Path(__file__).parent / "templates" / "invitations.html",
    invitations,
    help=message("Invite a guest by a link. Guests see the fleet, and can change nothing; the link ends by itself."),
    guide="docs/IDENTITIES.md",
)
