"""Bounded construction of Pinocchio models from URDF. Importing this takes 60 MB, so import it on demand."""

import pinocchio as pin

from linked_fleet_agent.urdf.writer import plain_urdf
from linked_fleet_state.model import ModelError, RobotModel

# Pinocchio's Data holds tensors of nv³: 128 take 0.3 s and 150 MB, 512 take 20 s and 9 GB, and a URDF is untrusted.
MAX_DEGREES = 128


def build_model(urdf: str, floating: bool) -> pin.Model:
    """Return Pinocchio's model. It reads what our reader has understood, and not the text of the robot.

    Raises ModelError if the URDF is invalid or has more than ``MAX_DEGREES`` of freedom.
    """
    text = plain_urdf(RobotModel.for_urdf(urdf), shapes=False)
    try:
        model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer()) if floating else pin.buildModelFromXML(text)
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"Pinocchio cannot compute this robot: {error}") from error
    if model.nv > MAX_DEGREES:
        raise ModelError(f"{model.nv} degrees of freedom are too many to plan with; {MAX_DEGREES} are not")
    return model
