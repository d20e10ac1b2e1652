"""The layers ("rooms") of the gateway that handle a GET, a POST, a frame and a message.

``make architecture`` prints them. A gateway and a robot run in one event loop on virtual time. Each call of a gateway
function while a request, frame or message is handled is recorded: its layer, and whether the caller is in a lower layer
(a climb).
"""

import contextlib
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from actor import Actor, stage
from bench.architecture import ROOT, rank, room_of
from browser import Browser
from running import eventually, process
from small_fleet import Place
from virtual.client import clients_in_memory
from virtual.loop import virtual_time

_FOLDER = ROOT / "gateway"
_GATEWAY = str(_FOLDER / "linked_fleet_gateway") + "/"


@dataclass
class Visits:
    rooms: dict[str, None] = field(default_factory=dict)
    files: dict[str, None] = field(default_factory=dict)
    calls = 0
    climbs = 0

    def note(self, frame: FrameType, event: str, _: Any) -> None:
        if event != "call" or not frame.f_code.co_filename.startswith(_GATEWAY):
            return
        room = _room(frame)
        self.calls += 1
        self.rooms[room] = None
        self.files[frame.f_code.co_filename.removeprefix(_GATEWAY)] = None
        caller = frame.f_back
        if caller is not None and caller.f_code.co_filename.startswith(_GATEWAY):
            self.climbs += rank(_room(caller)) < rank(room)


def _room(frame: FrameType) -> str:
    path = Path(frame.f_code.co_filename).relative_to(_FOLDER).with_suffix("")
    return room_of(".".join(path.parts))


@contextlib.contextmanager
def visits() -> Iterator[Visits]:
    found = Visits()
    sys.setprofile(found.note)
    try:
        yield found
    finally:
        sys.setprofile(None)


def measured(what: str, do: Callable[[], object]) -> None:
    do()  # loads what the first call needs
    with visits() as found:
        do()
    rooms = ", ".join(sorted(found.rooms, key=lambda each: (-rank(each), each)))
    print(f"| {what} | {len(found.rooms)}: {rooms} | {len(found.files)} | {found.calls} | {found.climbs} |")


def main() -> None:
    with contextlib.ExitStack() as stack:
        loop = stack.enter_context(virtual_time())
        stack.enter_context(clients_in_memory(loop))
        place = Place(Path(stack.enter_context(tempfile.TemporaryDirectory())))
        stack.enter_context(process(*place.command(), "--history-s", "0")).said("serving")
        actor = Actor(stack.enter_context(stage(place.zenoh)), "odd").appear()
        browser = stack.enter_context(contextlib.closing(Browser(place.root)))
        value, action = f"{place.root}odd/elbow/rotation", f"{place.root}actions/stopAll"
        eventually(lambda: browser.http.get(value).status_code == 200, "the robot")
        angles = iter(range(1, 1000))

        def get() -> None:
            browser.http.get(value, headers={"accept": "text/turtle", "x-now": str(time.monotonic_ns())})

        def stop() -> None:
            browser.http.post(action).raise_for_status()

        def frame() -> None:
            actor.put("state", actor.frame((next(angles) / 1000,)))
            loop.run_for(0.05)

        print("| | rooms | files | calls | climbs |\n|---|---|---|---|---|")
        measured("GET of a live value", get)
        measured("POST of a stop", stop)
        measured("frame that nobody watches", frame)
        with browser.http.stream("GET", value, headers={"accept": "text/event-stream"}):
            measured("frame → message of one subscriber", frame)


if __name__ == "__main__":
    main()
