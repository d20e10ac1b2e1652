"""Answers of agents, judged, and the count of messages that are refused."""

import logging
from collections import Counter
from collections.abc import Collection

from msgspec import structs

from linked_fleet_agent.wire.codec import WireError, decode, decode_reply
from linked_fleet_agent.wire.components import DescriptionWithComponents
from linked_fleet_agent.wire.messages import Description, Reply


def read_reply(answer: bytes | str, id: str) -> tuple[Reply | None, str]:
    if isinstance(answer, str):
        return None, answer
    try:
        reply = decode_reply(answer)
    except WireError as error:
        return None, f"the answer is no reply: {error}"
    return (reply, "") if reply.id == id else (None, f"the answer is to command {reply.id[:64]!r}")


_NO_COMPONENTS = b"[]"


class DescriptionAndComponents(Description, frozen=True, kw_only=True):
    """The description of a robot, and the declarations of its components in JSON, which are not decoded."""

    components: bytes = _NO_COMPONENTS


def read_description(answer: bytes | str, robot: str, runs: Collection[int]) -> tuple[Description | None, str]:
    """Check a description. ``runs`` are the runs of the robot that have a presence token."""
    if isinstance(answer, str):
        return None, answer
    try:
        said = decode(answer, DescriptionWithComponents)
    except WireError as error:
        return None, str(error)
    if said.robot == robot and said.incarnation in runs:
        members = structs.asdict(said)
        declared = bytes(members.pop("components"))  # a copy, so that the answer, which has the URDF too, can be freed
        if declared == _NO_COMPONENTS:
            return Description(**members), ""
        return DescriptionAndComponents(**members, components=declared), ""
    return None, (
        f"the description is of robot {said.robot!r} in run {said.incarnation}, "
        f"but the presence token is of {robot!r} in run {max(runs, default=0)}"
    )


MAX_SENDERS = 1000
MAX_SENDER = 400
_OTHERS = "(others)"


class RejectedMessages:
    """Counts by sender. Senders beyond the bound share one entry, so that invented names cannot fill memory."""

    def __init__(self, log: logging.Logger) -> None:
        self.counts: Counter[str] = Counter()
        self._log = log

    def add(self, sender: str, reason: object) -> None:
        sender = sender[:MAX_SENDER]  # for a sender that is no robot, this is a key
        if sender not in self.counts and len(self.counts) >= MAX_SENDERS:
            sender = _OTHERS
        self.counts[sender] += 1
        if self.counts[sender] == 1:
            self._log.warning("%.200r sent something that is refused (logged once): %.500s", sender, reason)

    def forget(self, sender: str) -> None:
        """Free the entry of a sender; the sum of all counts stays."""
        count = self.counts.pop(sender, 0)
        if count:
            self.counts[_OTHERS] += count
