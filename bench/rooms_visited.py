"""The layers ("rooms") of the gateway that handle a GET, a POST, a frame and a message.

``make architecture`` prints them. A gateway and a robot run in one event loop on virtual time. Each call of a gateway
function while a request, frame or message is handled is recorded: its layer, and whether the caller is in a lower layer
(a climb). Comprehensions are no calls, and background loops are not counted. A hand-over is a call by the event loop
that continues the work in a later iteration.
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

from bench.architecture import PACKAGES, ROOT, rank, room_of
from browser import Browser
from fake_robots import FakeRobot, open_session
from running import eventually, process
from small_fleet import Place
from virtual.client import clients_in_memory
from virtual.loop import virtual_time

_FOLDER = ROOT / "gateway"
_PACKAGES = tuple(str(_FOLDER / each) + "/" for each in ("linked_fleet_gateway", *PACKAGES))
_COMPREHENSIONS = frozenset({"<listcomp>", "<setcomp>", "<dictcomp>", "<genexpr>"})
_BACKGROUND = "_repeat"  # of linked_fleet_runtime.background


@dataclass
class Visits:
    rooms: dict[str, None] = field(default_factory=dict)
    files: dict[str, None] = field(default_factory=dict)
    calls = 0
    climbs = 0
    hand_overs = -1
    _others: FrameType | None = None
    """The call of a background loop that runs at present."""

    def note(self, frame: FrameType, event: str, _: Any) -> None:
        if frame is self._others and event == "return":
            self._others = None
        if event != "call" or self._others is not None or not _is_counted(frame):
            return
        if not any(map(_is_counted, _callers(frame))):
            if frame.f_code.co_name == _BACKGROUND:
                self._others = frame
                return
            self.hand_overs += 1
        room = _room(frame)
        self.calls += 1
        self.rooms[room] = None
        self.files[frame.f_code.co_filename.removeprefix(f"{_FOLDER}/")] = None
        caller = frame.f_back
        if caller is not None and caller.f_code.co_filename.startswith(_PACKAGES):
            self.climbs += rank(_room(caller)) < rank(room)


def _is_counted(frame: FrameType) -> bool:
    return frame.f_code.co_filename.startswith(_PACKAGES) and frame.f_code.co_name not in _COMPREHENSIONS


def _callers(frame: FrameType) -> Iterator[FrameType]:
    while (caller := frame.f_back) is not None:
        yield caller
        frame = caller


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
    counts = len(found.files), found.calls, found.hand_overs, found.climbs
    print(f"| {what} | {len(found.rooms)}: {rooms} | {' | '.join(map(str, counts))} |")


def main() -> None:
    with contextlib.ExitStack() as stack:
        loop = stack.enter_context(virtual_time())
        stack.enter_context(clients_in_memory(loop))
        place = Place(Path(stack.enter_context(tempfile.TemporaryDirectory())))
        stack.enter_context(process(*place.command(), "--history-s", "0")).said("serving")
        actor = FakeRobot(stack.enter_context(open_session(place.zenoh)), "odd").appear().confirm_stops()
        browser = stack.enter_context(contextlib.closing(Browser(place.root)))
        value, action = f"{place.root}odd/elbow/rotation", f"{place.root}actions/stopAll"
        eventually(lambda: browser.http.get(value).status_code == 200, "the robot")
        angles, others = iter(range(1, 1000)), iter(("velocity", "effort"))

        def get() -> None:
            browser.http.get(value, headers={"accept": "text/turtle", "x-now": str(time.monotonic_ns())})

        def first() -> None:
            browser.http.get(f"{place.root}odd/elbow/{next(others)}", headers={"accept": "text/turtle"})

        def stop() -> None:
            browser.http.post(action).raise_for_status()

        def frame() -> None:
            actor.put("state", actor.frame((next(angles) / 1000,)))
            loop.run_for(0.05)

        print("| | rooms | files | calls | hand-overs | climbs |\n|---|---|---|---|---|---|")
        measured("GET of a live value, for the first time", first)
        measured("GET of a live value, read before", get)
        measured("POST of a stop", stop)
        measured("frame that nobody watches", frame)
        with browser.http.stream("GET", value, headers={"accept": "text/event-stream"}):
            measured("frame → message of one subscriber", frame)


if __name__ == "__main__":
    main()
