"""Parsing of numbers, vectors and names in untrusted URDF. Every error is a ModelError with a clear sentence."""

import math
import re
from typing import Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from linked_fleet_agent.wire.keys import MAX_NAME_BYTES

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


class ModelError(ValueError):
    """A URDF that does not describe one robot; the text is a sentence for people."""


def parse_xml(text: str) -> Element:
    """Return the root element.

    Raises ModelError with the line. Document types are refused, so that no entity expands.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ModelError("the URDF declares a document type or an entity, which no URDF needs and this reader refuses")
    try:
        return ElementTree.fromstring(text)  # noqa: S314
    except ElementTree.ParseError as error:
        line, column = error.position
        reason = str(error).partition(":")[0]
        raise ModelError(f"the URDF is no well-formed XML: {reason} in line {line}, column {column + 1}") from error
    except (ValueError, RecursionError) as error:
        raise ModelError(f"the URDF is no text that XML allows: {error}") from error


def name_of(element: Element, where: str) -> str:
    name = element.get("name", "").strip()
    if not 0 < len(name.encode()) <= MAX_NAME_BYTES:
        raise ModelError(f"{where} has no name of 1 to {MAX_NAME_BYTES} bytes")
    return name


def number(text: str, where: str) -> float:
    value = float(text) if _NUMBER.fullmatch(text.strip()) else math.nan
    if not math.isfinite(value):
        raise ModelError(f"{where} is {text[:40]!r}, not a finite number")
    return value


def optional_number(element: Element | None, attribute: str, where: str) -> float | None:
    text = None if element is None else element.get(attribute)
    return None if text is None else number(text, f"{attribute} of {where}")


def required_number(element: Element | None, attribute: str, where: str) -> float:
    value = optional_number(element, attribute, where)
    if value is None:
        raise ModelError(f"{where} lacks {attribute}")
    return value


def vector(element: Element | None, attribute: str, default: Vector, where: str) -> Vector:
    text = None if element is None else element.get(attribute)
    if text is None:
        return default
    parts = text.split()
    if len(parts) != 3:
        raise ModelError(f"{attribute} of {where} is {text[:60]!r}, not three numbers")
    x, y, z = (number(part, f"{attribute} of {where}") for part in parts)
    return x, y, z


def unit_vector(given: Vector, where: str) -> Vector:
    length = math.hypot(*given)
    if not 1e-9 < length < math.inf:
        raise ModelError(f"the axis of {where} is {given}, which has no direction")
    return given[0] / length, given[1] / length, given[2] / length


def quaternion(rpy: Vector) -> Quaternion:
    """Return the quaternion x y z w of fixed-axis roll, pitch, yaw in radian (https://wiki.ros.org/urdf/XML/joint,
    origin).
    """
    (sr, sp, sy), (cr, cp, cy) = ([f(angle / 2) for angle in rpy] for f in (math.sin, math.cos))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def rotation(q: Quaternion) -> tuple[Vector, Vector, Vector]:
    """Return the rows of the rotation matrix of a unit quaternion x y z w."""
    x, y, z, w = q
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
