"""Bounded construction of Pinocchio models from URDF. Importing this takes 60 MB, so import it on demand."""

from xml.etree import ElementTree

import pinocchio as pin

from linked_fleet_gateway.fleet.model import ModelError
from linked_fleet_gateway.fleet.xml import parse_xml

# Pinocchio's Data holds tensors of nv³: 128 take 0.3 s and 150 MB, 512 take 20 s and 9 GB, and a URDF is untrusted.
MAX_DEGREES = 128


def build_model(urdf: str, floating: bool) -> pin.Model:
    """Return Pinocchio's model.

    Raises ModelError if the URDF is invalid or has more than ``MAX_DEGREES`` of freedom.
    """
    urdf = _with_limits(urdf)
    try:
        model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer()) if floating else pin.buildModelFromXML(urdf)
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"Pinocchio refuses the URDF: {error}") from error
    if model.nv > MAX_DEGREES:
        raise ModelError(f"{model.nv} degrees of freedom are too many to plan with; {MAX_DEGREES} are not")
    return model


def _with_limits(urdf: str) -> str:
    """Return a URDF in which every joint has the limits that urdfdom demands; they are not used for planning."""
    root = parse_xml(urdf)
    for joint in root.findall("joint"):
        if joint.get("type") in ("revolute", "prismatic"):
            limit = joint.find("limit")
            limit = ElementTree.SubElement(joint, "limit") if limit is None else limit
            for name in ("lower", "upper", "effort", "velocity"):
                limit.attrib.setdefault(name, "0")
    return ElementTree.tostring(root, encoding="unicode")
