"""The resources that a fault links, as far as they are there now: robots are removed, and invocations forgotten."""

from typing import NamedTuple

from linked_fleet_gateway.api import Core, Member, thing_at
from linked_fleet_gateway.extensions.faults.fault import Fault
from linked_fleet_gateway.extensions.faults.recording import recording_of
from linked_fleet_gateway.extensions.recordings.recorder import Recorder


class Links(NamedTuple):
    """Paths of what a fault is about, of its evidence and of its recording; empty for what is not there."""

    about: str = ""
    evidence: str = ""
    recording: str = ""


class Linking:
    """Finds the links of faults, as the reader of a fault sees the fleet."""

    def __init__(self, core: Core) -> None:
        self._core, self._recorder = core, core.optional_service(Recorder)

    def of(self, member: Member[Fault]) -> Links:
        """Return the links of a fault. Those of a robot lead to the robot if the part is not there any more."""
        trouble, view = member.record.trouble, member.view
        invocation = trouble.invocation.rpartition("/")[2]
        known = bool(invocation) and view.invocations.get(invocation) is not None
        recording = "" if self._recorder is None else recording_of(self._recorder, member.record)
        return Links(self._about(member), trouble.invocation if known else "", recording)

    def _about(self, member: Member[Fault]) -> str:
        trouble, view = member.record.trouble, member.view
        if thing_at(trouble.place, view.robots) is not None:
            return trouble.place
        robot = "/" + trouble.place[1:].partition("/")[0] + "/"
        if thing_at(robot, view.robots) is not None:
            return robot
        tree = self._core.live.tree(view.base, view.visible_robots)
        return trouble.place if tree.resolve(trouble.place) is not None else ""
