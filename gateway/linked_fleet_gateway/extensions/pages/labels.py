"""How pages call things: terms in words, numbers with few digits, units as they are written, times in UTC."""

import math
import re
from functools import lru_cache
from typing import TYPE_CHECKING
from zlib import crc32

from linked_fleet_agent.wire.names import unescape
from linked_fleet_gateway.base.lazy_imports import Lazily
from linked_fleet_gateway.rdf.vocabulary import ROS, XHV
from linked_fleet_gateway.resources.paths import reserved_at_root, reserved_in_robot

if TYPE_CHECKING:
    from linked_fleet_client import quantity
else:
    quantity = Lazily("linked_fleet_client.quantity")

_LARGE, _SMALL, _DECIMALS = 1e6, 1e-4, 4
_CONVERTED = {"rad": (180 / math.pi, "°", 1), "m": (1000.0, " mm", 1)}
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z0-9.]+|[^A-Za-z0-9\s_-]+")
_CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ufffe\uffff]")
_SPELT = {XHV.prev.value: "previous", ROS.preceedingLink.value: "preceding link"}
_LINK_MARK = "~link"


def clean(text: str) -> str:
    """The text with a mark for each character that HTML cannot hold."""
    return _CONTROL.sub("\ufffd", text)


def number(value: float) -> str:
    """At most four decimals; face/src/format.js writes the same."""
    size = abs(value)
    if size >= _LARGE or 0 < size < _SMALL:
        mantissa, exponent = f"{value:.{_DECIMALS}e}".split("e")
        return f"{_trimmed(mantissa)}e{'-' if exponent[0] == '-' else '+'}{exponent[1:].lstrip('0') or '0'}"
    return _rounded(value, _DECIMALS)


def converted(value: float, unit: str) -> str:
    """An angle in rad also in degrees, a length in m also in mm; empty for any other ``unit``."""
    if unit not in _CONVERTED or not math.isfinite(value):
        return ""
    scale, name, decimals = _CONVERTED[unit]
    return _rounded(value * scale, decimals) + name


def _rounded(value: float, decimals: int) -> str:
    text = _trimmed(f"{value:.{decimals}f}")
    return "0" if text == "-0" else text


def _trimmed(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text


@lru_cache(maxsize=256)
def unit(iri: str) -> str:
    """The unit as people write it, ``N·m`` for ``unit:N-M``; empty for a mere number."""
    return quantity.unit_label(iri).replace(" ", "·").replace("m2", "m²").replace("deg", "°")


@lru_cache(maxsize=4096)
def words(iri: str) -> str:
    """A term in words: ``lf:lastSeen`` is "last seen"."""
    local = iri.rstrip("#/").replace("#", "/").rpartition("/")[2]
    said = [each if each.isupper() and len(each) > 1 else each.lower() for each in _WORD.findall(local)]
    return _SPELT.get(iri) or clean(" ".join(said)) or clean(iri)


def local_name(iri: str) -> str:
    """Return the text after the last ``#`` or ``/``."""
    return clean(iri.rstrip("#/").replace("#", "/").rpartition("/")[2] or iri)


@lru_cache(maxsize=4096)
def segment_name(segment: str, depth: int) -> str:
    """The name that a segment of a path stands for; ``depth`` is 0 for what is below the root."""
    try:
        return clean(unescape(segment.removesuffix(_LINK_MARK), reserved_in_robot() if depth else reserved_at_root()))
    except ValueError:
        return clean(segment)


def place(iri: str, root: str) -> str:
    """Return the name of a resource of this fleet by its path; ``root`` ends with a slash."""
    segments = [each for each in iri.removeprefix(root).split("/") if each]
    return segment_name(segments[-1], len(segments) - 1) if segments else "fleet"


def moment(lexical: str) -> str:
    """An xsd:dateTime in UTC to the millisecond, or as it is if it is of another form."""
    found = re.fullmatch(r"(\d{4}-\d\d-\d\d)T(\d\d:\d\d:\d\d)(\.\d+)?Z", lexical)
    return f"{found[1]} {found[2]}{(found[3] or '.000')[:4]} UTC" if found else clean(lexical)


def named(iri: str) -> str:
    """Return the label of an IRI to choose: a part by its name, a term in words."""
    return words(iri) if "#" in iri else segment_name(iri.rstrip("/").rpartition("/")[2], 1)


def mark(iri: str) -> str:
    """A short name for ids, the same for the same IRI: several forms may come to one page."""
    return f"f{crc32(iri.encode()):08x}"
