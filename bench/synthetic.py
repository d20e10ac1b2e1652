"""Many robots without bodies in one process: what agents say on the wire, and nothing that moves.

``python -m bench.synthetic ENDPOINT COUNT JOINTS MODELS`` is a Zenoh router at ENDPOINT; gateways connect to it. Each
line on its standard input is answered with one line of JSON: ``appear`` brings the robots in, ``rate HZ`` has each send
so many frames a second from then on, ``moving COUNT`` sets how many joints of each move (one, to begin with), an empty
line asks what has been done since the last one. It ends with its input.

The first joints of every robot stand at the time of its frame, in seconds since the ``epoch_ns`` of CLOCK_MONOTONIC, as
radian: whoever reads one knows how old it is.
"""

import json
import math
import os
import queue
import resource
import struct
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import zenoh

from linked_fleet_agent.wire.codec import decode, encode, encode_state, layout
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.messages import WIRE_VERSION, Accepted, Command, Description, Progress, State, Stop

Asked = Literal["description", "command", "stop"]
Answer = Callable[[bytes], bytes]
KEYS = Keys()
_TICK_S = 0.001
_TIMES = struct.Struct("<Qqq")  # sequence, monotonic and wall time of a frame
_LAYOUT = {each.name: each.offset for each in layout(1, False)}


def name_of(number: int) -> str:
    return f"robot-{number:05}"


def urdf(joints: int, model: int = 0) -> str:
    """An arm of so many continuous joints, a chain of links with all that URDF says of them. Each model is another."""
    link = (
        '<link name="link_{0}"><inertial><origin xyz="0 0 0.05" rpy="0 0 0"/><mass value="1.5"/>'
        '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.005"/></inertial>'
        '<visual><origin xyz="0 0 0.05" rpy="0 0 0"/><geometry><cylinder radius="0.05" length="0.1"/></geometry>'
        "</visual></link>"
    )
    joint = (
        '<joint name="joint_{0}" type="continuous"><parent link="link_{0}"/><child link="link_{1}"/>'
        '<origin xyz="0 0 0.1" rpy="0 0 0"/><axis xyz="0 0 1"/><limit velocity="2" effort="100"/>'
        '<dynamics friction="0.1" damping="0.2"/></joint>'
    )
    links = "".join(link.format(number) for number in range(joints + 1))
    return f'<robot name="synthetic-{model}">{links}{"".join(joint.format(n, n + 1) for n in range(joints))}</robot>'


@dataclass
class Robot:
    """One run of one agent. Its frame is encoded once; of each that is sent only time and place are written anew."""

    name: str
    run: int
    description: bytes
    frame: bytearray
    publisher: Any = None
    sequence: int = 0
    kept: list[Any] = field(default_factory=list)

    def send(self, epoch_ns: int, moving: int = 1) -> None:
        now_ns = time.monotonic_ns()
        _TIMES.pack_into(self.frame, _LAYOUT["sequence"], self.sequence, now_ns, time.time_ns())
        places = [(now_ns - epoch_ns) / 1e9] * moving
        struct.pack_into(f"<{moving}d", self.frame, _LAYOUT["positions"], *places)
        self.publisher.put(bytes(self.frame))
        self.sequence += 1


def robot(name: str, joints: int, model: str) -> Robot:
    names = tuple(f"joint_{number}" for number in range(joints))
    run = time.time_ns()
    description = Description(
        version=WIRE_VERSION, robot=name, incarnation=run, title=f"Synthetic {name}", urdf=model, joints=names,
        rate_hz=100, capabilities=("move",), layout=layout(joints, False),
    )  # fmt: skip
    rest, unknown = (0.1,) * joints, (math.nan,) * joints
    frame = State(
        incarnation=run, sequence=0, monotonic_ns=0, wall_ns=0, positions=rest, velocities=rest, efforts=unknown
    )
    return Robot(name, run, encode(description), bytearray(encode_state(frame)))


class Crowd:
    """All robots on one session. Frames leave in one thread, answers in those of Zenoh."""

    def __init__(self, session: zenoh.Session, count: int, joints: int, models: int) -> None:
        self.epoch_ns = time.monotonic_ns()
        self.rate_hz, self.moving = 0.0, 1
        self._session = session
        self._done: Counter[str] = Counter()
        made = [urdf(joints, number) for number in range(models)]
        self._here: list[Robot] = []
        self._all = [robot(name_of(number), joints, made[number % models]) for number in range(count)]
        self._ended = threading.Event()
        self._questions: queue.SimpleQueue[tuple[Any, str, Answer] | None] = queue.SimpleQueue()
        self._ends: queue.SimpleQueue[tuple[Robot, bytes] | None] = queue.SimpleQueue()
        self._threads = [threading.Thread(target=each) for each in (self._answer, self._end, self._send)]
        for each in self._threads:
            each.start()

    def appear(self) -> dict[str, int]:
        """One after another, each with its first frame; when the first and the last had (CLOCK_MONOTONIC)."""
        first_ns = time.monotonic_ns()
        for each in self._all:
            self._declare(each)
            each.send(self.epoch_ns)
            self._here.append(each)
        return {"first_ns": first_ns, "last_ns": time.monotonic_ns()}

    def counted(self) -> dict[str, Any]:
        usage = resource.getrusage(resource.RUSAGE_SELF)
        done, self._done = self._done, Counter()
        return {"cpu_s": usage.ru_utime + usage.ru_stime, "frames": done["frame"], "asked": done["description"]}

    def close(self) -> None:
        self._ended.set()
        self._questions.put(None)
        self._ends.put(None)
        for each in self._threads:
            each.join()

    def _declare(self, each: Robot) -> None:
        """What agents/linked_fleet_agent/link.py declares, in its order."""
        session, name = self._session, each.name
        each.publisher = session.declare_publisher(
            KEYS.robot(name, "state"),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA,
            express=False,
        )
        answers: tuple[tuple[Asked, Answer], ...] = (
            ("description", lambda _: each.description), ("command", partial(self._obey, each)), ("stop", _stand),
        )  # fmt: skip
        for kind, answer in answers:
            key = KEYS.robot(name, kind)
            each.kept.append(session.declare_queryable(key, self._in_turn(key, answer), complete=True))
        each.kept.append(session.liveliness().declare_token(KEYS.presence(name, each.run)))

    def _in_turn(self, key: str, answer: Answer) -> Any:
        """Answered by one thread for all: one for each would be too many, and Zenoh's own must not wait for room."""
        return zenoh.handlers.Callback(lambda query: self._questions.put((query, key, answer)), indirect=False)

    def _answer(self) -> None:
        while (question := self._questions.get()) is not None:
            query, key, answer = question
            self._done[key.rpartition("/")[2]] += 1
            with query:
                query.reply(key, answer(b"" if query.payload is None else query.payload.to_bytes()))

    def _obey(self, each: Robot, payload: bytes) -> bytes:
        """Accept every command, and be there at once."""
        command = decode(payload, Command)
        end = Progress(
            version=WIRE_VERSION, id=command.id, incarnation=command.incarnation, state="succeeded",
            wall_ns=time.time_ns(), progress=1.0,
        )  # fmt: skip
        self._ends.put((each, encode(end)))
        return encode(Accepted(id=command.id, at_ns=time.monotonic_ns()))

    def _end(self) -> None:
        """After the acceptance has left, or about then."""
        while (end := self._ends.get()) is not None:
            key = KEYS.robot(end[0].name, "progress")
            self._session.put(key, end[1], congestion_control=zenoh.CongestionControl.BLOCK, express=True)

    def _send(self) -> None:
        """Evenly over the time; what cannot be kept up with is left out, never made up for."""
        begin, sent, rate_hz, number = time.monotonic(), 0, 0.0, 0
        while not self._ended.wait(_TICK_S):
            if rate_hz != self.rate_hz or not self._here:
                begin, sent, rate_hz = time.monotonic(), 0, self.rate_hz
            due = int((time.monotonic() - begin) * rate_hz * len(self._here))
            for _ in range(min(due - sent, len(self._here))):
                self._here[number % len(self._here)].send(self.epoch_ns, self.moving)
                self._done["frame"] += 1
                number += 1
            sent = due


def _stand(payload: bytes) -> bytes:
    return encode(Accepted(id=decode(payload, Stop).id, at_ns=time.monotonic_ns()))


def main() -> None:
    endpoint, (count, joints, models) = sys.argv[1], map(int, sys.argv[2:5])
    config = zenoh.Config()
    for key, value in {
        "mode": "router",
        "listen/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
        "scouting/gossip/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        crowd = Crowd(session, count, joints, models)
        print(json.dumps({"epoch_ns": crowd.epoch_ns, "pid": os.getpid()}), flush=True)
        try:
            for line in sys.stdin:
                what, _, value = line.strip().partition(" ")
                if what == "rate":
                    crowd.rate_hz = float(value)
                elif what == "moving":
                    crowd.moving = int(value)
                print(json.dumps(crowd.appear() if what == "appear" else crowd.counted()), flush=True)
        finally:
            crowd.close()


if __name__ == "__main__":
    main()
