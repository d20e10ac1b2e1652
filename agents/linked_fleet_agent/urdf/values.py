"""Numbers, vectors and names of URDF elements, and findings. Every error is a UrdfError with a clear sentence."""

import math
import re
from dataclasses import dataclass, field
from typing import Final, Literal
from xml.etree.ElementTree import Element

from linked_fleet_agent.urdf.document import UrdfError
from linked_fleet_agent.wire.keys import MAX_NAME_BYTES

Vector = tuple[float, float, float]
About = Literal["robot", "joint", "link"]
_MOST: Final = 1e12
"""The largest length, mass or other quantity in SI units; products of several must not overflow in other readers."""
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_ENDLESS: Final = re.compile(r"([+-]?)(inf|infinity|1\.#inf)", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True)
class Finding:
    """A sentence about a part of the description that was left out, repaired or refused."""

    about: About
    name: str
    sentence: str


@dataclass
class Findings:
    """Collects the findings of one description, in the order of the file."""

    found: list[Finding] = field(default_factory=list)

    def add(self, about: About, name: str, sentence: str) -> None:
        self.found.append(Finding(about, name, sentence))


def named(about: str, name: str) -> str:
    """Return a part as the subject of a sentence, such as ``Joint 'j1'``."""
    return f"{about.capitalize()} {name!r}"


def only(element: Element, tag: str, about: About, name: str, findings: Findings) -> Element | None:
    """Return the first child with this tag; more of them are reported, because only one has a meaning."""
    found = element.findall(tag)
    if len(found) > 1:
        findings.add(about, name, f"{named(about, name)} has {len(found)} elements <{tag}>; the first one is read.")
    return found[0] if found else None


def name_of(element: Element, where: str) -> str:
    """Return the name without white space around it. Raises UrdfError."""
    name = element.get("name", "").strip()
    if not 0 < len(name.encode()) <= MAX_NAME_BYTES:
        raise UrdfError(f"{where} has no name of 1 to {MAX_NAME_BYTES} bytes")
    return name


def number(text: str, where: str) -> float:
    """Return a finite number that a robot may have. Raises UrdfError."""
    value = extended_number(text, where)
    if not math.isfinite(value):
        raise UrdfError(f"{where} is {text[:40]!r}, not a finite number")
    if abs(value) > _MOST:
        raise UrdfError(f"{where} is {text[:40]!r}, beyond {_MOST:g}, which no robot has")
    return value


def extended_number(text: str, where: str) -> float:
    """Return a number, which may be infinite. Raises UrdfError."""
    text = text.strip()
    if _NUMBER.fullmatch(text):
        return float(text)
    endless = _ENDLESS.fullmatch(text)
    if endless is None:
        raise UrdfError(f"{where} is {text[:40]!r}, not a finite number")
    return -math.inf if endless[1] == "-" else math.inf


def optional_number(element: Element | None, attribute: str, where: str) -> float | None:
    text = None if element is None else element.get(attribute)
    return None if text is None else number(text, f"{attribute} of {where}")


def required_number(element: Element | None, attribute: str, where: str) -> float:
    value = optional_number(element, attribute, where)
    if value is None:
        raise UrdfError(f"{where} lacks {attribute}")
    return value


def vector(element: Element | None, attribute: str, default: Vector, where: str) -> Vector:
    """Return three finite numbers. Raises UrdfError."""
    text = None if element is None else element.get(attribute)
    if text is None:
        return default
    x, y, z = numbers(text, 3, f"{attribute} of {where}")
    return x, y, z


_COMMA: Final = re.compile(r",(?=\s)")
_COUNTS: Final = {3: "three", 4: "four"}


def numbers(text: str, count: int, where: str) -> list[float]:
    """Return this many finite numbers, between which commas may stand beside the space. Raises UrdfError."""
    parts = _COMMA.sub(" ", text).split()
    if len(parts) != count:
        raise UrdfError(f"{where} is {text[:60]!r}, not {_COUNTS[count]} numbers")
    return [number(part, where) for part in parts]


def unit_vector(given: Vector, where: str) -> Vector:
    """Return the vector at length 1. Raises UrdfError if it has no direction."""
    length = math.hypot(*given)
    if not 1e-9 < length < math.inf:
        raise UrdfError(f"the axis of {where} is {given}, which has no direction")
    return given[0] / length, given[1] / length, given[2] / length
