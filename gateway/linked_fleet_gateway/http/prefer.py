"""Preferences of the client: ``Prefer`` (RFC 7240)."""

import re
from dataclasses import dataclass
from typing import Literal

from linked_fleet_gateway.http.fields import TOKEN, parameters, split, unquote

MAX_WAIT_S = 60.0
Return = Literal["minimal", "representation"]


@dataclass(frozen=True)
class Prefer:
    """The preferences that we know; unknown and malformed ones are ignored (section 2)."""

    return_: Return | None = None
    respond_async: bool = False
    wait_s: float | None = None
    dry_run: bool = False
    """Ours: say what the action would do, and do nothing."""
    include: frozenset[str] = frozenset()
    omit: frozenset[str] = frozenset()
    """IRIs of the parts of a representation that are wanted, and that are not (LDP 7.2)."""


def parse_prefer(header: str | None) -> Prefer:
    """The header's values, joined by commas when there were several; the first of a repeated preference counts."""
    said: dict[str, str] = {}
    parts: dict[str, str] = {}
    for member in split(header or "", ","):
        preference, *rest = split(member, ";") or [""]
        name, equals, value = (part.strip(" \t") for part in preference.partition("="))
        text = unquote(value) if equals else ""
        # section 2: an empty value is the same as none
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
    """Delta-seconds, digits alone; nobody keeps us waiting for more than ``MAX_WAIT_S``."""
    if value is None or not re.fullmatch(r"[0-9]+", value):
        return None
    return min(float(value), MAX_WAIT_S)


def preference_applied(
    *, return_: Return | None = None, respond_async: bool = False, wait_s: float | None = None
) -> str | None:
    """The value of ``Preference-Applied`` (section 3) for what was honoured, None when nothing was."""
    applied = [f"return={return_}"] if return_ else []
    applied += ["respond-async"] if respond_async else []
    applied += [f"wait={wait_s:.0f}"] if wait_s is not None else []
    return ", ".join(applied) or None
