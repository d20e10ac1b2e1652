"""Parts of long replies (PROTOCOL.md, "Parts of a reply"): the attachments of the query and of the reply."""

import hashlib
import re
from typing import NamedTuple

MAX_ATTACHMENT_BYTES = 256
PART_BYTES = 65_536
"""Content up to this length is one part at first."""
_REQUEST = re.compile(rb"part (-|[0-9a-f]{16}) ([0-9]{1,10}) ([1-9][0-9]{0,9})")
_HEAD = re.compile(rb"part ([0-9a-f]{16}) ([0-9]{1,10})")


class PartRequest(NamedTuple):
    """A request for at most ``length`` bytes from byte ``start`` of the content with this ``tag``.

    ``tag`` is empty in the first request, which does not know the content yet.
    """

    tag: str
    start: int
    length: int

    def encode(self) -> bytes:
        return f"part {self.tag or '-'} {self.start} {self.length}".encode()


class PartHead(NamedTuple):
    """The tag and the length in bytes of the whole content, beside a part of it."""

    tag: str
    total: int

    def encode(self) -> bytes:
        return f"part {self.tag} {self.total}".encode()


def parse_request(attachment: bytes) -> PartRequest | None:
    """Return the request in the attachment of a query; None if it has none."""
    match = _REQUEST.fullmatch(attachment)
    return PartRequest(match[1].decode().strip("-"), int(match[2]), int(match[3])) if match else None


def parse_head(attachment: bytes) -> PartHead | None:
    """Return the head in the attachment of a reply; None if the reply is whole."""
    match = _HEAD.fullmatch(attachment)
    return PartHead(match[1].decode(), int(match[2])) if match else None


def content_tag(content: bytes) -> str:
    """Return the tag of a content: the first 16 hexadecimal digits of its SHA-256 digest."""
    return hashlib.sha256(content).hexdigest()[:16]
