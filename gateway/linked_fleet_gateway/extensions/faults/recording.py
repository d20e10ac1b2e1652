"""The recording of the 30 s before a fault: that of its invocation, or one that is made when it is confirmed."""

import uuid
from collections.abc import Mapping

from linked_fleet_gateway.extensions.faults.fault import Fault
from linked_fleet_gateway.extensions.recordings.occasion import Occasion
from linked_fleet_gateway.extensions.recordings.recorder import Recorder

_MOST_KNOWN = 4096


def recording_of(recorder: Recorder, fault: Fault) -> str:
    """Return the path of the recording of a fault; empty if there is none here."""
    robot, invocation = next(iter(fault.trouble.robots), ""), fault.trouble.invocation.rpartition("/")[2]
    return recorder.path_of(robot, invocation or _id(fault))


def _id(fault: Fault) -> str:
    """Return the id of a recording of this appearance of a fault, which is the same at all gateways."""
    return str(uuid.uuid5(uuid.UUID(fault.trouble.id), str(fault.confirmed_ns)))


class Recording:
    """Records the robot of each fault that is confirmed now. Information and faults of invocations need none."""

    def __init__(self, recorder: Recorder, known: Mapping[str, Fault]) -> None:
        self._recorder, self._known = recorder, known
        self._done: dict[str, None] = {}

    def look(self) -> None:
        """Record what has been confirmed since the last look."""
        for fault in list(self._known.values()):
            trouble = fault.trouble
            if fault.state != "confirmed" or trouble.invocation or trouble.severity == "information":
                continue
            if (id := _id(fault)) in self._done or self._recorder.is_old(fault.confirmed_ns):
                continue
            self._done[id] = None
            if len(self._done) > _MOST_KNOWN:
                del self._done[next(iter(self._done))]
            about = {"id": trouble.id, "kind": trouble.kind, "place": trouble.place, "severity": trouble.severity}
            is_error = trouble.severity != "warning"
            for robot in trouble.robots[:1]:
                self._recorder.record(robot, Occasion(id, fault.confirmed_ns, trouble.says, is_error, "fault", about))
