"""Entity tags and preconditions (RFC 9110, 8.8.3, 13.1.1 and 13.1.2)."""

import re
from collections.abc import Collection
from hashlib import blake2b

_TAG = re.compile(r'(W/)?("[\x21\x23-\x7e\x80-\xff]*")')
_CODED = re.compile(r'-(?:gzip|br)"$')
_LIST = re.compile(rf"[ \t,]*(?:{_TAG.pattern}[ \t]*(?:,[ \t,]*|$))*")


def etag(body: bytes) -> str:
    """Return the strong entity tag of these bytes."""
    return f'"{blake2b(body, digest_size=16).hexdigest()}"'


def not_modified(if_none_match: str | None, etag: str) -> bool:
    """Return True if the client has this representation already: ``*`` or weak comparison (13.1.2)."""
    if if_none_match is None:
        return False
    opaque = _plain(etag.removeprefix("W/"))
    return if_none_match.strip() == "*" or any(tag == opaque for _, tag in _tags(if_none_match))


def precondition_holds(if_match: str | None, etags: Collection[str], *, exists: bool = True) -> bool:
    """Return True if a write may proceed: ``*`` if the resource exists, or a current tag (13.1.1)."""
    if if_match is None:
        return True
    if if_match.strip() == "*":
        return exists
    strong = {_plain(tag) for tag in etags if not tag.startswith("W/")}
    return exists and any(tag in strong for weak, tag in _tags(if_match) if not weak)


def _tags(field: str) -> list[tuple[str, str]]:
    """Return the tags of a well-formed list. A malformed one has none, which is safe in both directions."""
    return [(weak, _plain(tag)) for weak, tag in _TAG.findall(field)] if _LIST.fullmatch(field) else []


def _plain(tag: str) -> str:
    """Return the tag without its content coding, so that readers of coded representations can write."""
    return _CODED.sub('"', tag)
