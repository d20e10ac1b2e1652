"""A hostile gateway: the agent decides alone, and no step of the simulator exceeds a limit of the URDF."""

import asyncio
import json
import math
import random
from collections.abc import Iterator

import pytest

from fake_robots import KEYS
from linked_fleet_agent.pace import every
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.messages import Accepted, Refused, Reply, Stop
from linked_fleet_agent.wire.transport import HEARTBEAT_S
from linked_fleet_link.transport import Answer, Question
from linked_fleet_state.events import Payload
from running import eventually, free_port
from simulated_robots import RESTING_RAD_S, SimulatedRobot, simulated
from virtual.processes import gateway_session

pytestmark = pytest.mark.virtual
ROBOT = "ur5"
PAN = "shoulder_pan_joint"


class Hostile:
    """Sends anything on the keys of gateways, and receives the robot's frames."""

    def __init__(self, endpoint: str) -> None:
        self.seen_ns = self.incarnation = 0
        self._number = 0
        asyncio.run(self._open(endpoint))

    async def _open(self, endpoint: str) -> None:
        self._session, self._present = await gateway_session(endpoint), await gateway_session(endpoint)
        await self._session.subscribe(KEYS.robot(ROBOT, "state"), 2**20, self._saw)
        await self._present.declare_token(KEYS.gateway("hostile"))
        beat = self._present.declare_heartbeat(KEYS.heartbeat("hostile"))
        self._beating = asyncio.create_task(every(HEARTBEAT_S, beat))

    def _saw(self, _: str, payload: Payload) -> None:
        assert isinstance(payload, bytes)
        state = codec.decode_state(payload)
        self.seen_ns, self.incarnation = state.monotonic_ns, state.incarnation

    def ask(self, payload: bytes, key: str = "command") -> Reply:
        return asyncio.run(self._ask(Question(KEYS.robot(ROBOT, key), payload, 30.0, 2**20)))

    async def _ask(self, question: Question) -> Reply:
        answers: asyncio.Queue[Answer | None] = asyncio.Queue()
        await self._session.ask(question, answers.put_nowait)
        answer = await answers.get()
        assert answer is not None and isinstance(answer.payload, bytes)
        return codec.decode_reply(answer.payload)

    def command(self, motion: object, **more: object) -> Reply:
        """Send a command that is valid except for the given fields."""
        self._number += 1
        good = {
            "version": 1, "id": f"h{self._number}", "incarnation": self.incarnation, "seen_ns": self.seen_ns,
            "time_to_live_ns": 60_000_000_000, "motion": motion,
        }  # fmt: skip
        return self.ask(json.dumps(good | more).encode())

    def move(self, **targets: float) -> Reply:
        return self.command({"type": "move", "targets": targets})

    def gone(self) -> None:
        self._beating.cancel()
        asyncio.run(self._present.close())


@pytest.fixture
def pair() -> Iterator[tuple[Hostile, SimulatedRobot]]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with simulated(endpoint, ROBOT) as robots:
        hostile = Hostile(endpoint)
        eventually(lambda: hostile.seen_ns, "a frame")
        robot = robots[ROBOT]
        robot.watch()
        yield hostile, robot
        robot.check_limits()


def _held(robot: SimulatedRobot) -> list[float] | None:
    """Return the setpoints of the servos, if they have not changed for a while of the robot's own time."""
    before, start = robot.setpoints(), robot.data.time
    eventually(lambda: robot.data.time > start + 0.3, "the robot's time")
    return before if robot.setpoints() == before and robot.speed() < RESTING_RAD_S else None


def test_invalid_commands_are_refused_and_move_nothing(pair: tuple[Hostile, SimulatedRobot]) -> None:
    hostile, robot = pair
    eventually(lambda: isinstance(hostile.move(**{PAN: 0.0}), Accepted), "an agent that sees the gateway")
    before = eventually(lambda: _held(robot), "a robot that holds")
    good, now = {"type": "move", "targets": {PAN: 1.0}}, hostile.seen_ns
    refused = [
        hostile.move(**{PAN: 100.0}),
        hostile.move(**{PAN: 1e308}),
        hostile.move(nose=1.0),
        hostile.move(),
        hostile.command(good, scale=1e9),
        hostile.command(good, scale=-1.0),
        hostile.command({"type": "follow", "joints": [PAN], "times_s": [1e-9], "positions": [[3.0]]}),
        hostile.command({"type": "follow", "joints": [PAN], "times_s": [1.0], "positions": [[3.0, 2.0]]}),
        hostile.command(good, time_to_live_ns=2**62),
        hostile.command(good, seen_ns=now + 3600 * 10**9),
        hostile.command(good, seen_ns=0, time_to_live_ns=1),
        hostile.command(good, incarnation=hostile.incarnation - 1),
        hostile.command(good, version=2),
        hostile.command(good, override_safety=True),
        *(hostile.ask(payload) for payload in (b"", b"\x00" * 60_000, b"{" * 10_000, b'{"version": NaN}', b"null")),
    ]
    assert not [reply for reply in refused if isinstance(reply, Accepted)]
    assert robot.setpoints() == before


def test_accepted_commands_keep_within_the_limits(pair: tuple[Hostile, SimulatedRobot]) -> None:
    """As many commands as it can send, each contrary to the one before, with stops in between; then it vanishes."""
    hostile, robot = pair
    chance = random.Random(7)
    accepted = 0
    for _ in range(400):
        last = hostile.seen_ns
        eventually(lambda last=last: hostile.seen_ns > last, "a frame")
        targets = {
            name: chance.choice((joint.limits.lower or -math.pi, joint.limits.upper or math.pi, chance.uniform(-3, 3)))
            for name, joint in robot.joints.items()
        }
        match chance.randrange(4):
            case 0:
                names = list(targets)
                motion = {"type": "follow", "joints": names, "times_s": [4.0, 8.0],
                          "positions": [list(targets.values()), [-each for each in targets.values()]]}  # fmt: skip
                accepted += isinstance(hostile.command(motion), Accepted)
            case 1:
                hostile.ask(codec.encode(Stop(version=1, id=f"s{chance.random()}"[:20].replace(".", ""))), "stop")
            case _:
                accepted += isinstance(hostile.move(**targets), Accepted)
    assert accepted > 20
    robot.check_limits()
    hostile.gone()
    tried = {"type": "move", "targets": {PAN: 1.0}}
    eventually(lambda: isinstance(hostile.command(tried, rehearsal=True), Refused), "a robot that knows no gateway")
    held = eventually(lambda: _held(robot), "a robot that holds")
    late = hostile.move(**{PAN: 1.0})
    assert (late.code if not isinstance(late, Accepted) else "") in ("fault", "stale")
    assert robot.setpoints() == held
