"""The escape that makes any name a safe URI path segment and a safe Zenoh key chunk.

Bytes of the UTF-8 form outside ``A-Z a-z 0-9 _ . -`` become ``~XX`` (upper-case hex). If the whole name is reserved (or
``.`` or ``..``), its first byte is escaped as well. The rule is reversible and every name has exactly one segment; any
other spelling is refused.
"""

import re
from collections.abc import Container

MAX_NAME_BYTES = 128
_PLAIN = frozenset(b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_.-")
_AS_IT_IS = re.compile(r"[A-Za-z0-9_.-]{1,128}", re.ASCII)
"""Names that equal their segment, unless reserved."""


def escape(name: str, reserved: Container[str] = ()) -> str:
    """Return the segment of ``name``. Raises ValueError if it is empty or longer than 128 bytes in UTF-8."""
    escape_first = name in (".", "..") or name in reserved
    if not escape_first and _AS_IT_IS.fullmatch(name):
        return name
    raw = name.encode()
    if not 0 < len(raw) <= MAX_NAME_BYTES:
        raise ValueError(f"a name has 1 to {MAX_NAME_BYTES} bytes, not {len(raw)}")
    return "".join(
        chr(byte) if byte in _PLAIN and not (escape_first and index == 0) else f"~{byte:02X}"
        for index, byte in enumerate(raw)
    )


def unescape(segment: str, reserved: Container[str] = ()) -> str:
    """Return the name of ``segment``. Raises ValueError if the segment is not the canonical one of any name."""
    if segment not in (".", "..") and segment not in reserved and _AS_IT_IS.fullmatch(segment):
        return segment
    head, *rest = segment.split("~")
    try:
        raw = head.encode("ascii") + b"".join(bytes.fromhex(part[:2]) + part[2:].encode("ascii") for part in rest)
        name = raw.decode()
        if escape(name, reserved) == segment:
            return name
    except ValueError:
        pass
    raise ValueError(f"{segment!r} is not the segment of a name")
