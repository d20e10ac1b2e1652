"""Many agents without robots in one process: they send what agents send, but nothing moves.

``python -m bench.synthetic ENDPOINT COUNT JOINTS MODELS`` is a Zenoh router at ENDPOINT, to which gateways connect.
With two more arguments, the number of its first robot and a count of namespaces, it is a client of the router at
ENDPOINT, and robot n is in namespace n modulo that count.

Each line on standard input is answered with one line of JSON: ``appear`` announces all robots, ``appear COUNT`` the
next ones, ``rate HZ`` sets the frames per second of each, ``moving COUNT`` the number of moving joints of each
(initially one), and an empty line asks for the work since the last one. It ends when its input ends.

The first joints of every robot have as position, in rad, the time of its frame in seconds since the ``epoch_ns`` of
CLOCK_MONOTONIC, so that a reader can compute the age of a value.
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
"""The keys of the first namespace."""
_TICK_S = 0.001
_TIMES = struct.Struct("<Qqq")  # sequence, monotonic and wall time of a frame
_LAYOUT = {each.name: each.offset for each in layout(1, False)}


def name_of(number: int) -> str:
    return f"robot-{number:05}"


def keys_of(number: int, namespaces: int) -> Keys:
    place = number % namespaces
    return Keys(f"{KEYS.namespace}-{place}") if place else KEYS


def urdf(joints: int, model: int = 0) -> str:
    """Return an arm of so many continuous joints with all elements of URDF; each model is different."""
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
    """One run of one agent. Its frame is encoded once; then only time and position are replaced."""

    name: str
    run: int
    description: bytes
    frame: bytearray
    keys: Keys = KEYS
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


def robot(name: str, joints: int, model: str, keys: Keys = KEYS) -> Robot:
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
    return Robot(name, run, encode(description), bytearray(encode_state(frame)), keys)


class Crowd:
    """All robots on one session. Frames are sent by one thread, answers by those of Zenoh."""

    def __init__(
        self, session: zenoh.Session, count: int, joints: int, models: int, first: int = 0, namespaces: int = 1
    ) -> None:
        self.epoch_ns = time.monotonic_ns()
        self.rate_hz, self.moving = 0.0, 1
        self._session = session
        self._done: Counter[str] = Counter()
        made = [urdf(joints, number) for number in range(models)]
        self._here: list[Robot] = []
        numbers = range(first, first + count)
        self._all = [
            robot(name_of(number), joints, made[number % models], keys_of(number, namespaces)) for number in numbers
        ]
        self._ended = threading.Event()
        self._questions: queue.SimpleQueue[tuple[Any, str, Answer] | None] = queue.SimpleQueue()
        self._ends: queue.SimpleQueue[tuple[Robot, bytes] | None] = queue.SimpleQueue()
        self._threads = [threading.Thread(target=each) for each in (self._answer, self._end, self._send)]
        for each in self._threads:
            each.start()

    def appear(self, count: int | None = None) -> dict[str, int]:
        """Announce the next robots in turn, all by default, each with its first frame.

        Return the first and last time (CLOCK_MONOTONIC).
        """
        first_ns, begin = time.monotonic_ns(), len(self._here)
        for each in self._all[begin : None if count is None else begin + count]:
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
        """Declare what agents/linked_fleet_agent/link.py declares, in the same order."""
        session, name, keys = self._session, each.name, each.keys
        each.publisher = session.declare_publisher(
            keys.robot(name, "state"),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA,
            express=False,
        )
        answers: tuple[tuple[Asked, Answer], ...] = (
            ("description", lambda _: each.description), ("command", partial(self._obey, each)), ("stop", _stand),
        )  # fmt: skip
        for kind, answer in answers:
            key = keys.robot(name, kind)
            each.kept.append(session.declare_queryable(key, self._in_turn(key, answer), complete=True))
        tokens = (keys.robot(name, "state"), keys.presence(name, each.run))
        each.kept += [session.liveliness().declare_token(key) for key in tokens]

    def _in_turn(self, key: str, answer: Answer) -> Any:
        """Answer in one thread for all robots.

        One thread each would be too many, and Zenoh's own threads must not wait for room.
        """
        return zenoh.handlers.Callback(lambda query: self._questions.put((query, key, answer)), indirect=False)

    def _answer(self) -> None:
        while (question := self._questions.get()) is not None:
            query, key, answer = question
            self._done[key.rpartition("/")[2]] += 1
            with query:
                query.reply(key, answer(b"" if query.payload is None else query.payload.to_bytes()))

    def _obey(self, each: Robot, payload: bytes) -> bytes:
        """Accept every command, and reach its target at once."""
        command = decode(payload, Command)
        end = Progress(
            version=WIRE_VERSION, id=command.id, incarnation=command.incarnation, state="succeeded",
            wall_ns=time.time_ns(), progress=1.0,
        )  # fmt: skip
        self._ends.put((each, encode(end)))
        return encode(Accepted(id=command.id, at_ns=time.monotonic_ns()))

    def _end(self) -> None:
        """Report the end of the motion, after or about when the acceptance is sent."""
        while (end := self._ends.get()) is not None:
            key = end[0].keys.robot(end[0].name, "progress")
            self._session.put(key, end[1], congestion_control=zenoh.CongestionControl.BLOCK, express=True)

    def _send(self) -> None:
        """Send frames evenly over time; frames that are late are left out, never made up for."""
        begin, sent, rate_hz, here, number = time.monotonic(), 0, 0.0, 0, 0
        while not self._ended.wait(_TICK_S):
            if rate_hz != self.rate_hz or here != len(self._here):
                begin, sent, rate_hz, here = time.monotonic(), 0, self.rate_hz, len(self._here)
            due = int((time.monotonic() - begin) * rate_hz * here)
            for _ in range(min(due - sent, here)):
                self._here[number % len(self._here)].send(self.epoch_ns, self.moving)
                self._done["frame"] += 1
                number += 1
            sent = due


def _stand(payload: bytes) -> bytes:
    return encode(Accepted(id=decode(payload, Stop).id, at_ns=time.monotonic_ns()))


def main() -> None:
    endpoint, (count, joints, models, *place) = sys.argv[1], map(int, sys.argv[2:])
    role = {"mode": "client", "connect/endpoints": [endpoint]} if place else {"listen/endpoints": [endpoint]}
    config = zenoh.Config()
    for key, value in {
        "mode": "router",
        **role,
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
        "scouting/gossip/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        crowd = Crowd(session, count, joints, models, *place)
        print(json.dumps({"epoch_ns": crowd.epoch_ns, "pid": os.getpid()}), flush=True)
        try:
            for line in sys.stdin:
                what, _, value = line.strip().partition(" ")
                if what == "rate":
                    crowd.rate_hz = float(value)
                elif what == "moving":
                    crowd.moving = int(value)
                said = crowd.appear(int(value) if value else None) if what == "appear" else crowd.counted()
                print(json.dumps(said), flush=True)
        finally:
            crowd.close()


if __name__ == "__main__":
    main()
