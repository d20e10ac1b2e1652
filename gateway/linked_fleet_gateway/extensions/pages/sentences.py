"""Sentences about tasks and requests, made from paths: "rotate right_s1" for an invocation of that action."""

import math
import re
from collections.abc import Mapping, Sequence
from urllib.parse import unquote

from linked_fleet_gateway.extensions.pages import labels
from linked_fleet_gateway.resources.paths import reserved_at_root

_ACTIONS = "actions"
_ADDRESS = re.compile(r"https?://\S*[^\s.,;:]|(?<=\bof )/\S*")


def segments(iri: str, root: str) -> list[str]:
    """Return the path segments below ``root``, which ends with a slash; ``iri`` may also be a path."""
    path = iri.removeprefix(root) if iri.startswith(root) else iri
    return [unquote(each) for each in path.partition("?")[0].split("/") if each]


def task(iri: str, root: str) -> str:
    """Describe an action, an invocation or what is below it in words: what is done, and to which joint."""
    found = segments(iri, root)
    if _ACTIONS not in found[:-1]:
        return labels.place(iri, root)
    at = found.index(_ACTIONS)
    joint = labels.segment_name(found[1], 1) if at == 2 else ""
    return f"{labels.words(found[at + 1])} {joint}".rstrip()


def thing(iri: str, root: str) -> str:
    """Describe a resource in words: "right_s1 of baxter", "placement of ur5", "the fleet"."""
    found = segments(iri, root)
    if not found:
        return "the fleet"
    if found[0] in reserved_at_root():
        return " ".join(labels.words(each) for each in found if not labels.is_id(each))
    return _of_robot(found)


def _of_robot(found: Sequence[str]) -> str:
    robot, rest = labels.segment_name(found[0], 0), [each for each in found[1:] if not labels.is_id(each)]
    if _ACTIONS in rest[:2] and rest[-1] != _ACTIONS:
        at = rest.index(_ACTIONS)
        parts = [labels.words(rest[at + 1]), *(labels.segment_name(each, 1) for each in rest[:at])]
        return f"{' '.join(parts)} of {robot}"
    names = [
        labels.words(each) if n or each != each.lower() else labels.segment_name(each, 1) for n, each in enumerate(rest)
    ]
    return " of ".join([*reversed(names), robot])


def plain(text: str, root: str) -> str:
    """Return a title for people: addresses in it become names."""
    return _ADDRESS.sub(
        lambda found: thing(found[0], root) if _ours(found[0], root) else labels.foreign(found[0]), text
    )


def _ours(address: str, root: str) -> bool:
    return address.startswith((root, "/"))


# -- motions --------------------------------------------------------------------------------------------------------


def capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def motion(iri: str, root: str, targets: Mapping[str, tuple[float, str]]) -> str:
    """Describe an invocation with its only target: "Rotate right_s1 to −100°". ``targets``: value and unit by joint."""
    said = capital(task(iri, root))
    if len(targets) > 1:
        return f"{said} ({len(targets)} joints)"
    for joint, (value, unit) in targets.items():
        of = "" if said.endswith(joint) else f" {joint}"
        return f"{said}{of} to {position(value, unit)}"
    return said


def position(value: float, unit: str) -> str:
    """Format an angle in degrees, a length in millimetres; ``unit`` as in data."""
    if not math.isfinite(value):
        return "an unknown position"
    shown = labels.converted(value, unit) or f"{labels.number(value)} {unit}".rstrip()
    return shown.replace("-", "\N{MINUS SIGN}")


# -- the audit ------------------------------------------------------------------------------------------------------

_DONE = {
    "PUT": "set",
    "POST": "add to",
    "PATCH": "change",
    "DELETE": "delete",
    "subscribe": "subscribe to",
    "unsubscribe": "end a subscription to",
}


def done(what: str, path: str) -> str:
    """Describe an audited request in words; ``what`` is its method, or the event of a stream."""
    found = segments(path, "/")
    if what == "RULE":
        return f"by a rule: {task(path, '/')}"
    if _ACTIONS in found[:-1] and what in ("PUT", "POST"):
        return task(path, "/")
    if what == "DELETE" and "invocations" in found[:-1]:
        return f"stop {task(path, '/')}"
    if what == "POST" and found[-1:] == ["subscriptions"]:
        return f"subscribe to {thing('/'.join(found[:-1]), '/')}"
    return f"{_DONE.get(what, labels.words(what))} {thing(path, '/')}"


def outcome(status: int | None) -> tuple[str, str]:
    """Return the outcome of a request in words and as a state; ``status`` is None without a response."""
    if status is None:
        return "ended", "idle"
    if status < 400:
        return "done", "succeeded"
    return (f"refused ({status})", "cancelled") if status < 500 else (f"failed ({status})", "failed")
