"""A URDF as Pinocchio's model, as far as it is safe to have one made. Takes 60 MB to import: only for who needs it."""

import pinocchio as pin

from linked_fleet_gateway.fleet.model import ModelError

# Pinocchio's Data holds tensors of nv³: 128 take 0.3 s and 150 MB, 512 take 20 s and 9 GB, and a URDF is hostile.
MAX_DEGREES = 128


def build_model(urdf: str, floating: bool) -> pin.Model:
    """Pinocchio's model; ModelError when it refuses the URDF or that has more than ``MAX_DEGREES`` of freedom."""
    try:
        model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer()) if floating else pin.buildModelFromXML(urdf)
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"Pinocchio refuses the URDF: {error}") from error
    if model.nv > MAX_DEGREES:
        raise ModelError(f"{model.nv} degrees of freedom are too many to plan with; {MAX_DEGREES} are not")
    return model
