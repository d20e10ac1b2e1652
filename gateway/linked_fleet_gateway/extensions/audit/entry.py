"""Entries of the audit, and their form in Redis. Pure."""

from collections.abc import Mapping, Sequence

from msgspec import Struct
from msgspec.structs import asdict, fields


class AuditEntry(Struct, frozen=True):
    """One entry. ``what`` is the method, or the event of a stream; ``outcome`` the response status, empty for an end.

    ``result`` is the path of the created invocation or subscription, ``reason`` why the request was refused. ``at_ns``
    is gateway wall time.
    """

    at_ns: int
    who: str
    what: str
    target: str
    robot: str
    outcome: str
    request: str
    result: str = ""
    reason: str = ""


def written(entry: AuditEntry) -> list[str]:
    """Return names and values of what an entry says."""
    return [text for name, value in asdict(entry).items() if value for text in (name, str(value))]


def read_entry(pairs: Sequence[bytes] | Mapping[bytes, bytes]) -> AuditEntry:
    items = list(pairs.items()) if isinstance(pairs, Mapping) else list(zip(pairs[::2], pairs[1::2], strict=True))
    said = {name.decode(): text.decode(errors="replace") for name, text in items}
    texts = {each.name: said.get(each.name, "") for each in fields(AuditEntry) if each.name != "at_ns"}
    return AuditEntry(int(said.get("at_ns", "0")), **texts)
