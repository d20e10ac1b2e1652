"""Web linking: a bounded ``Link`` field (RFC 8288) and the complete set of links as a document (RFC 9264)."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote as percent

from linked_fleet_gateway.http.fields import quote

LINKSET_TYPES = ("application/linkset+json", "application/linkset")
# RFC 3986, 2: reserved and unreserved characters and existing %XX stay; everything else is percent-encoded.
_LEAST_BYTES = len('<>; rel="", ')
_SAFE = "!#$%&'()*+,/:;=?@[]~"


@dataclass(frozen=True)
class Link:
    """A link from the present resource to ``target``.

    ``type`` is a hint of its media type. ``etag`` is the state of a collection of which the response is a page (WoT
    Discovery, 7.3.2.3).
    """

    target: str
    rel: str
    type: str | None = None
    etag: str | None = None


def link_header(own: Sequence[Link], parts: Sequence[Link], linkset: str | None = None, limit: int = 4096) -> str:
    """Return the field value, shorter than ``limit``: own links, then parts as they fit, then the link set if given.

    Room for the link set is reserved first, because it contains the links that do not fit.
    """
    last = [_member(Link(linkset, "linkset", LINKSET_TYPES[0]))] if linkset else []
    last = [member for member in last if len(member) < limit]
    room = limit - sum(len(member) + 2 for member in last)
    members: list[str] = []
    for link in [*own, *parts]:
        if len(link.target) + len(link.rel) + _LEAST_BYTES >= room:
            continue
        member = _member(link)
        if len(member) + 2 >= room:
            continue
        room -= len(member) + 2
        members.append(member)
    return ", ".join([*members, *last])


def _target(target: str) -> str:
    encoded = percent(target, safe=_SAFE)
    return re.sub(r"%(?![0-9A-Fa-f]{2})", "%25", encoded)


def _member(link: Link) -> str:
    media_type = f"; type={quote(link.type)}" if link.type else ""
    state = f"; etag={quote(link.etag)}" if link.etag else ""
    return f"<{_target(link.target)}>; rel={quote(_ascii(link.rel))}{media_type}{state}"


def _ascii(text: str) -> str:
    """Percent-encode non-ASCII characters in a relation."""
    return text if text.isascii() else percent(text, safe=_SAFE + ' "\\')


def linkset_json(anchor: str, links: Sequence[Link]) -> bytes:
    """Return application/linkset+json (RFC 9264, 4.2): one link context object, targets grouped by relation."""
    context: dict[str, Any] = {"anchor": _target(anchor)}
    for link in links:
        target = {"href": _target(link.target)} | ({"type": link.type} if link.type else {})
        # a relation "anchor" would overwrite the context; no such relation is registered
        if link.rel != "anchor":
            context.setdefault(link.rel, []).append(target)
    return json.dumps({"linkset": [context]}, ensure_ascii=False).encode()


def linkset_text(anchor: str, links: Sequence[Link]) -> bytes:
    """Return application/linkset (RFC 9264, 4.1): the field syntax, one link per line, each with its anchor."""
    return ",\n".join(f"{_member(link)}; anchor={quote(_target(anchor))}" for link in links).encode()
