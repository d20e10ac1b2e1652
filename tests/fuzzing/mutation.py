"""Mutations of valid messages: JSON by its tree, Turtle by its terms, anything by its bytes."""

import json
import math
import re
from collections.abc import Sequence
from random import Random
from typing import Any

NUMBERS: tuple[float, ...] = (
    0, 1, -1, 2, 0.5, -0.5, 1e-9, 5e-324, 1e308, -1e308, 1e6, 1e6 + 1, 255, 256, 65_535, 65_536, 2**31, 2**53 + 1,
    2**63 - 1, 2**63, -(2**63), 2**64, 10**400, -0.0, math.nan, math.inf, -math.inf, math.pi, 60_000_000_000,
)  # fmt: skip
TEXTS = (
    "", " ", "x", "x" * 129, "x" * 70_000, "\0", "\n", "\u2028", "\ud800", "é", "e\u0301", "~", "~41", "~70ose", ".",
    "..",
    "../..", "/", "*", "**", "$*", "#", "?", "pose", "a b", "<b>", "'\"", "%s", "{}", "\U0001f916", "NaN", "1e400",
    "true",
    "null", "2026-01-01T00:00:00Z", "http://[", "urn:x", "\x1b[2J", "\u202e", "\ufeff",
)  # fmt: skip
_CHUNKS = (b"\0", b"\xff", b"\xc0\x80", b"\xed\xa0\x80", b"\r\n", b'"', b"{", b"[", b"\\u0000", b"1e999", b"\x80" * 8)
_TERM = re.compile(r'<[^>]*>|"(?:[^"\\]|\\.)*"(?:\^\^(?:<[^>]*>|[\w:]+)|@[\w-]+)?|[\w:.+-]*[\w:]|\S')
_DEEP = 60


def raw(random: Random, data: bytes) -> bytes:
    """Make one to four changes of bytes."""
    changed = bytearray(data)
    for _ in range(random.randint(1, 4)):
        _RAW[random.randrange(len(_RAW))](random, changed, random.randint(0, len(changed)))
    return bytes(changed)


def _flip(random: Random, data: bytearray, at: int) -> None:
    if at < len(data):
        data[at] ^= 1 << random.randrange(8)


def _cut(random: Random, data: bytearray, at: int) -> None:
    del data[at : at + random.choice((1, 2, 8, 1 << 20))]


def _insert(random: Random, data: bytearray, at: int) -> None:
    data[at:at] = random.choice(_CHUNKS)


def _repeat(random: Random, data: bytearray, at: int) -> None:
    piece = data[at : at + random.choice((1, 4, 16, 64))]
    data[at:at] = piece * random.choice((1, 1, 2, 50))


def _noise(random: Random, data: bytearray, at: int) -> None:
    data[at : at + 4] = random.randbytes(random.randint(0, 12))


_RAW = (_flip, _flip, _cut, _insert, _repeat, _noise)


def value(random: Random) -> Any:
    """Return a random JSON value."""
    kind = random.randrange(8)
    if kind < 3:
        return random.choice(NUMBERS)
    if kind < 5:
        return random.choice(TEXTS)
    if kind == 5:
        return random.choice((None, True, False))
    if kind == 6:
        return [value(random) for _ in range(random.choice((0, 1, 2, 3)))]
    return {random.choice(TEXTS[:12]): value(random) for _ in range(random.choice((0, 1, 2)))}


def tree(random: Random, document: Any, changes: int = 0) -> Any:
    """Make so many changes (0: one to three) anywhere in a document, possibly in place."""
    for _ in range(changes or random.choice((1, 1, 1, 2, 3))):
        places = list(_places(document))
        if not places:
            return value(random)
        holder, key = random.choice(places)
        _TREE[random.randrange(len(_TREE))](random, holder, key)
    return document


def _places(document: Any) -> list[tuple[Any, Any]]:
    found, pending = [], [document]
    while pending:
        holder = pending.pop()
        inner = holder.items() if isinstance(holder, dict) else enumerate(holder)
        for key, inside in inner:
            found.append((holder, key))
            if isinstance(inside, dict | list):
                pending.append(inside)
        if len(found) > 400:
            break
    return found


def _replace(random: Random, holder: Any, key: Any) -> None:
    holder[key] = value(random)


def _nudge(random: Random, holder: Any, key: Any) -> None:
    """Replace a value by one of the same type, which may be valid."""
    old = holder[key]
    if isinstance(old, bool):
        holder[key] = not old
    elif isinstance(old, int | float):
        holder[key] = random.choice((random.choice(NUMBERS), -old, old + 1, old // 3, random.uniform(-2, 2)))
    elif isinstance(old, str):
        holder[key] = random.choice((random.choice(TEXTS), old + random.choice(TEXTS), old[:-1], old.upper()))
    elif isinstance(old, list):
        holder[key] = random.choice((old[:-1], old + old, old[::-1], old * 400 if len(old) < 8 else []))
    else:
        _replace(random, holder, key)


def _drop(random: Random, holder: Any, key: Any) -> None:
    del holder[key]


def _add(random: Random, holder: Any, key: Any) -> None:
    if isinstance(holder, dict):
        holder[random.choice((*TEXTS, *map(str, holder)))] = value(random)
    else:
        holder.insert(key, random.choice((value(random), holder[key])))


def _bury(random: Random, holder: Any, key: Any) -> None:
    deep, array = holder[key], random.random() < 0.5
    for _ in range(random.choice((1, 2, _DEEP))):
        deep = [deep] if array else {"x": deep}
    holder[key] = deep


_TREE = (_replace, _replace, _nudge, _nudge, _nudge, _nudge, _drop, _add, _bury)


def dumped(document: Any) -> bytes:
    """Serialize like a careless program, including NaN and unpaired surrogates, which are not JSON."""
    return json.dumps(document, ensure_ascii=False).encode(errors="surrogatepass")


def terms(random: Random, text: str, others: Sequence[str], changes: int) -> str:
    """Change so many terms of Turtle (including punctuation): replace, drop, repeat or swap them."""
    found = _TERM.findall(text)
    for _ in range(changes):
        at = random.randrange(len(found))
        how = random.randrange(10)
        if how < 5:
            found[at] = random.choice(others)
        elif how == 5:
            found[at] = ""
        elif how == 6:
            found[at] = f"{found[at]} {found[at]}"
        elif how == 7:
            found[at] = f"[ {random.choice(others)} {found[at]} ]"
        elif how == 8:
            found[at] = f"{found[at]} , {random.choice(others)}"
        else:
            other = random.randrange(len(found))
            found[at], found[other] = found[other], found[at]
    return " ".join(found)
