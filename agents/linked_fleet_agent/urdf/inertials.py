"""The mass and inertia of links. Kilogram and metre."""

from dataclasses import dataclass
from typing import Final
from xml.etree.ElementTree import Element

from linked_fleet_agent.urdf.document import UrdfError
from linked_fleet_agent.urdf.poses import Quaternion, contradicts_itself, pose_of, rotation
from linked_fleet_agent.urdf.values import Findings, Vector, named, number, only, required_number

Inertia = tuple[float, float, float, float, float, float]
_MOMENTS: Final = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_REQUIRED: Final = frozenset({"ixx", "iyy", "izz"})


@dataclass(frozen=True)
class Inertial:
    """Inertia ixx ixy ixz iyy iyz izz about the centre of mass, in link axes, as stated in the file; None is unknown.

    Real files (TIAGo) contain matrices that are not positive definite.
    """

    mass_kg: float
    centre_m: Vector
    inertia_kg_m2: Inertia | None


def inertial_of(link: Element, name: str, findings: Findings) -> Inertial | None:
    """Return the inertial of a link; None if its mass is unknown.

    Raises UrdfError for an origin that contradicts itself.
    """
    element = only(link, "inertial", "link", name, findings)
    if element is None:
        if link.find("collision") is not None:
            findings.add("link", name, f"{named('link', name)} has no <inertial>: its mass is unknown.")
        return None
    if contradicts_itself(element.find("origin")):
        pose_of(element.find("origin"), f"the inertial of link {name!r}")
    try:
        return _inertial(element, name, findings)
    except UrdfError as error:
        findings.add("link", name, f"{named('link', name)} has an unusable <inertial>; its mass is unknown: {error}.")
        return None


def _inertial(element: Element, name: str, findings: Findings) -> Inertial:
    mass = required_number(element.find("mass"), "value", f"the mass of link {name!r}")
    if mass < 0:
        raise UrdfError(f"the mass of link {name!r} is {mass} kg, below zero")
    origin = pose_of(element.find("origin"), f"the inertial of link {name!r}")
    try:
        inertia = _rotated(_tensor(element.find("inertia"), name), origin.orientation_xyzw)
    except UrdfError as error:
        findings.add("link", name, f"{named('link', name)} has a mass, but its inertia is unknown: {error}.")
        inertia = None
    return Inertial(mass, origin.position_m, inertia)


def _tensor(element: Element | None, name: str) -> list[float]:
    where = f"the inertia of link {name!r}"
    if element is None:
        raise UrdfError(f"{where} lacks ixx")
    return [_moment(element, part, where) for part in _MOMENTS]


def _moment(element: Element, part: str, where: str) -> float:
    """Return a moment; those off the diagonal are zero if they are omitted."""
    text = element.get(part)
    if text is None and part not in _REQUIRED:
        return 0.0
    if text is None:
        raise UrdfError(f"{where} lacks {part}")
    return number(text, f"{part} of {where}")


def _rotated(inertia: list[float], orientation: Quaternion) -> Inertia:
    """Return R I Rᵀ: the tensor in the axes in which ``orientation`` is expressed."""
    xx, xy, xz, yy, yz, zz = inertia
    if orientation == (0.0, 0.0, 0.0, 1.0):
        return xx, xy, xz, yy, yz, zz  # the usual case stays exact
    tensor = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    rows = rotation(orientation)

    def entry(i: int, j: int) -> float:
        return sum(rows[i][k] * tensor[k][m] * rows[j][m] for k in range(3) for m in range(3))

    return entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)
