"""Header fields of permitted size that cost as much time as possible: one member that is repeated until it is full."""

from collections.abc import Iterator
from random import Random

MAX_BYTES = 15_000
"""Of 16 KiB of a head."""
MEMBERS: dict[str, tuple[str, ...]] = {
    "Accept": (
        "a/b,",
        "text/turtle;q=0.1,",
        "*/*;q=0.1,",
        "text/event-stream;q=0.1,",
        'a/b;x="y",',
        ";a=b",
        '"",',
        '""',
    ),
    "Accept-Encoding": ("gzip;q=0.1,", "a,", ";q=1,"),
    "Accept-Language": ("en;q=0.1,",),
    "Access-Control-Request-Headers": ("prefer,",),
    "Cache-Control": ("a=b,",),
    "Callback": ("http://127.0.0.1:9/,",),
    "Connection": ("upgrade,",),
    "Content-Type": (";a=b", "text/turtle,"),
    "Cookie": ("a=b;", "linked-fleet-session=x;", '"a";'),
    "Forwarded": ("for=127.0.0.1,", 'for="[::1]:1";', "for=x;by=y,"),
    "Idempotency-Key": ("k,",),
    "If-Match": ('"x",', "W/", '"x', " ,"),
    "If-None-Match": ('"x",', 'W/"x" ,', '"'),
    "Link": ("<a>;rel=type,", '<a>;rel="type', "<", '<a>;a="\\\\"'),
    "Prefer": ("wait=1,", "dry-run;", 'return=representation;include="a b c",', '"'),
    "Range": ("0-1,",),
    "Sec-WebSocket-Protocol": ("lf.turtle,",),
    "traceparent": ("00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01,",),
    "Upgrade": ("websocket,", "callback,"),
    "X-Forwarded-For": ("127.0.0.1,", "[::1]:1,"),
    "X-Request-Id": ("a,",),
    "Authorization": ("Bearer ", "a.b."),
    "Host": ("a.", "%41"),
    "Origin": ("http://a,",),
    "Last-Event-ID": ("1,",),
}
"""Members by name of the field."""


def families() -> Iterator[tuple[str, str]]:
    """Yield every field with each of its members, once as many as the gateway reads and once as many as fit."""
    for name, members in MEMBERS.items():
        for member in members:
            yield name, member * 60
            yield name, member * (MAX_BYTES // len(member))


def costly(random: Random) -> tuple[str, str]:
    """Return one field of random kind and length."""
    name = random.choice(tuple(MEMBERS))
    member = random.choice(MEMBERS[name])
    return name, member * random.choice((30, 63, 64, 65, MAX_BYTES // len(member)))
