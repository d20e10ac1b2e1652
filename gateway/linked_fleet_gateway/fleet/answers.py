"""Validation of agents' replies: each function returns a message, or None and a sentence about the error."""

from collections.abc import Collection

from linked_fleet_agent.wire.codec import WireError, decode, decode_reply
from linked_fleet_agent.wire.messages import Description, Mesh, Reply


def read_reply(answer: bytes | str, id: str) -> tuple[Reply | None, str]:
    if isinstance(answer, str):
        return None, answer
    try:
        reply = decode_reply(answer)
    except WireError as error:
        return None, f"the answer is no reply: {error}"
    return (reply, "") if reply.id == id else (None, f"the answer is to command {reply.id[:64]!r}")


def read_mesh(answer: bytes | str, mesh: Mesh) -> tuple[bytes | None, str]:
    """Check a mesh by its length only; computing a digest here would take too long."""
    if isinstance(answer, str):
        return None, answer
    if len(answer) != mesh.size:
        return None, f"the answer has {len(answer)} bytes, but the description says {mesh.size}"
    return answer, ""


def read_description(answer: bytes | str, robot: str, runs: Collection[int]) -> tuple[Description | None, str]:
    """Check a description. ``runs`` are the runs of the robot that have a presence token."""
    if isinstance(answer, str):
        return None, answer
    try:
        said = decode(answer, Description)
    except WireError as error:
        return None, str(error)
    if said.robot == robot and said.incarnation in runs:
        return said, ""
    return None, (
        f"the description is of robot {said.robot!r} in run {said.incarnation}, "
        f"but the presence token is of {robot!r} in run {max(runs, default=0)}"
    )
