"""Robots and gateways played by a test: Zenoh sessions (in memory on virtual time) that send what the test says."""

import contextlib
import itertools
import json
import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import zenoh

from linked_fleet_agent.wire.codec import decode, encode, encode_state, layout
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.messages import WIRE_VERSION, Accepted, Description, State, Stop
from virtual.loop import current

KEYS = Keys()
_runs = itertools.count(1)


def link(name: str, inertial: bool = True) -> str:
    inner = (
        '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
        if inertial
        else ""
    )
    return f'<link name="{name}">{inner}</link>'


def joint(name: str, kind: str, parent: str, child: str, more: str = "") -> str:
    limit = '<limit lower="-1" upper="1" velocity="2" effort="3"/>' if kind in ("revolute", "prismatic") else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 1"/><axis xyz="0 0 1"/>{limit}{more}</joint>'
    )


def robot(*parts: str) -> str:
    return f'<robot name="synthetic">{"".join(parts)}</robot>'


SIMPLE = robot(link("base"), link("tip"), joint("elbow", "revolute", "base", "tip"))


class FakeRobot:
    """One run of a robot's agent; it sends nothing by itself."""

    def __init__(self, session: zenoh.Session, name: str) -> None:
        self.session, self.name = session, name
        self.behind_s = 0.0
        """How far its clock is behind."""
        self.incarnation = next(_runs)
        self._sequence = itertools.count()
        self._kept: list[object] = []

    def description(
        self,
        urdf: str = SIMPLE,
        joints: tuple[str, ...] = ("elbow",),
        annotations: str = "",
        floating: bool = False,
        version: int = WIRE_VERSION,
    ) -> bytes:
        return encode(
            Description(
                version=version,
                robot=self.name,
                incarnation=self.incarnation,
                title=f"The {self.name}",
                urdf=urdf,
                base="floating" if floating else "fixed",
                joints=joints,
                rate_hz=100,
                capabilities=("move",),
                annotations=annotations,
                layout=layout(len(joints), floating),
            )
        )

    def appear(self, description: bytes | None = None) -> "FakeRobot":
        key, said = KEYS.robot(self.name, "description"), description or self.description()
        self._kept.append(self.session.declare_queryable(key, lambda query: query.reply(key, said)))
        token = KEYS.presence(self.name, self.incarnation)
        self._kept.append(self.session.liveliness().declare_token(token))
        return self

    def confirm_stops(self) -> "FakeRobot":
        """Answer stops as a robot that stands; without this call nobody answers them."""
        key = KEYS.robot(self.name, "stop")

        def answer(query: zenoh.Query) -> None:
            assert query.payload is not None
            stop = decode(query.payload.to_bytes(), Stop)
            query.reply(key, encode(Accepted(stop.id, at_ns=time.monotonic_ns())))

        self._kept.append(self.session.declare_queryable(key, answer))
        return self

    def frame(self, positions: Sequence[float], incarnation: int | None = None) -> bytes:
        unknown = (math.nan,) * len(positions)
        return encode_state(
            State(
                incarnation=self.incarnation if incarnation is None else incarnation,
                sequence=next(self._sequence),
                monotonic_ns=time.monotonic_ns(),
                wall_ns=time.time_ns() - int(self.behind_s * 1e9),
                positions=tuple(positions),
                velocities=unknown,
                efforts=unknown,
            )
        )

    def stand(self, *positions: float) -> "FakeRobot":
        """Send frames with these positions until the session closes; a first frame may precede knowledge of the run."""

        _repeat(self.session, 0.05, lambda: self.put("state", self.frame(positions)))
        return self

    def put(self, kind: str, payload: bytes) -> None:
        self.session.put(f"{KEYS.namespace}/robot/{KEYS.robot(self.name, 'state').split('/')[-2]}/{kind}", payload)

    def keep(self, declaration: object) -> None:
        self._kept.append(declaration)

    def leave(self) -> None:
        """Undeclare everything, the presence first."""
        while self._kept:
            self._kept.pop().undeclare()  # type: ignore[attr-defined]


def _repeat(session: zenoh.Session, period_s: float, act: Callable[[], None]) -> None:
    """Call ``act`` periodically until the session closes: in a thread, or by timers on virtual time."""
    loop, pause = current(), threading.Event()

    def tick() -> None:
        if loop is not None and not session.is_closed():
            act()
            loop.call_later(period_s, tick)

    def run() -> None:
        with contextlib.suppress(zenoh.ZError):
            while not session.is_closed():
                act()
                pause.wait(period_s)

    if loop is not None:
        tick()
    else:
        threading.Thread(target=run, daemon=True).start()


@contextlib.contextmanager
def open_session(endpoint: str) -> Iterator[zenoh.Session]:
    """Open a client session that waits until something listens at ``endpoint``."""
    loop = current()
    if loop is not None:
        from virtual.processes import played_session  # it imports the product, which few tests need

        played = played_session(loop, endpoint)
        try:
            yield played
        finally:
            played.close()
        return
    settings = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": -1,
        "connect/retry": {"period_init_ms": 20, "period_max_ms": 100, "period_increase_factor": 1.5},
    }
    with real_session(settings) as session:
        yield session


@contextlib.contextmanager
def real_session(settings: Mapping[str, object]) -> Iterator[zenoh.Session]:
    """Open a session with these settings, without scouting and shared memory, and close it at the end."""
    config = zenoh.Config()
    apart = {"scouting/multicast/enabled": False, "transport/shared_memory/enabled": False}
    for name, value in {**settings, **apart}.items():
        config.insert_json5(name, json.dumps(value))
    session = zenoh.open(config)
    try:
        yield session
    finally:
        session.close()


@contextlib.contextmanager
def many_robots(session: zenoh.Session, count: int) -> Iterator[list[FakeRobot]]:
    """Yield robots ``robot-0000`` and so on, each of which sends a new position once a second."""
    actors = [FakeRobot(session, f"robot-{number:04}").appear() for number in range(count)]
    ended = threading.Event()

    def send() -> None:
        angle = 0.0
        while not ended.wait(1.0):
            angle = 0.5 - angle
            for actor in actors:
                actor.put("state", actor.frame([angle]))

    sender = threading.Thread(target=send)
    sender.start()
    try:
        yield actors
    finally:
        ended.set()
        sender.join()
