"""Preferences of the client: ``Prefer`` (RFC 7240)."""

import re
from dataclasses import dataclass
from typing import Literal

from linked_fleet_gateway.http.fields import TOKEN, parameters, split, unquote

MAX_WAIT_S = 60.0
Return = Literal["minimal", "representation"]


@dataclass(frozen=True)
class Prefer:
    """The known preferences; unknown and malformed ones are ignored (section 2)."""

    return_: Return | None = None
    respond_async: bool = False
    wait_s: float | None = None
    dry_run: bool = False
    """Our own preference: describe the effect of the action without executing it."""
    include: frozenset[str] = frozenset()
    omit: frozenset[str] = frozenset()
    """IRIs of parts of a representation to include and to omit (LDP 7.2)."""


def parse_prefer(header: str | None) -> Prefer:
    """Parse the field, with several lines joined by commas; the first of a repeated preference counts."""
    said: dict[str, str] = {}
    parts: dict[str, str] = {}
    for member in split(header or "", ","):
        preference, *rest = split(member, ";") or [""]
        name, equals, value = (part.strip(" \t") for part in preference.partition("="))
        text = unquote(value) if equals else ""
        # section 2: an empty value equals none
        if TOKEN.fullmatch(name) and (text is not None or value == ""):
            if name.lower() == "return" and "return" not in said:
                parts = dict(each for each in parameters(rest) if each is not None)
            said.setdefault(name.lower(), text or "")
    return Prefer(
        _return(said.get("return")),
        said.get("respond-async") == "",
        _wait(said.get("wait")),
        "dry-run" in said,
        frozenset(parts.get("include", "").split()),
        frozenset(parts.get("omit", "").split()),
    )


def _return(value: str | None) -> Return | None:
    return "minimal" if value == "minimal" else "representation" if value == "representation" else None


def _wait(value: str | None) -> float | None:
    """Return delta-seconds, digits only, at most ``MAX_WAIT_S``."""
    if value is None or not re.fullmatch(r"[0-9]+", value):
        return None
    return min(float(value), MAX_WAIT_S)
