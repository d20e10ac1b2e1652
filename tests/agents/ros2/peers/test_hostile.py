"""A hostile node beside real robots of ROS 2: what it sends costs its topics alone, and the agent goes on."""

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import zenoh

from connections import http_client
from linked_fleet_agent.robots.ros2.graph import Interface
from linked_fleet_agent.robots.ros2.transports import KEEP_LAST_ONE, DdsBridge, RmwZenoh, Transport
from linked_fleet_agent.robots.ros2.types import MessageTypes
from linked_fleet_client.fleet import Fleet, Thing
from linked_fleet_client.vocabulary import LF
from robot_client import await_angle, begin, end_of, joint_angle
from ros_hostile import DESCRIPTIONS as OF_TYPES
from ros_hostile import RIDDLES, TRAP, Liar
from ros_peers import SOURCES, URDF, behind_bridge, on_rmw_zenoh
from running import Process, eventually, process
from small_fleet import Place

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

HASH = f"RIHS01_{'0' * 64}"
HEAD = b"\x00\x01\x00\x00"
SIDES: dict[str, tuple[Any, Transport]] = {
    "ros2": (on_rmw_zenoh, RmwZenoh(0, "1234567890abcdef", "hostile")),
    "ros2dds": (behind_bridge, DdsBridge()),
}
STATES = Interface("/joint_states", "sensor_msgs/msg/JointState")
BATTERY = Interface("/battery_state", "sensor_msgs/msg/BatteryState")
DIAGNOSTICS = Interface("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
DESCRIPTION = Interface("/robot_description", "std_msgs/msg/String")
LAMP = Interface("/lamp", "std_msgs/msg/Bool")
TOPICS = (STATES, BATTERY, DIAGNOSTICS, LAMP)
TYPES = MessageTypes()
RATE_HZ, FLOOD_S = 10_000, 3.0
MOST_MIB = 150
"""How much more memory an agent may need for all that it is sent."""


class Hostile(NamedTuple):
    """A node that sends what it likes, and the agent that hears it."""

    session: zenoh.Session
    transport: Transport
    agent: Process

    def put(self, topic: Interface, payload: bytes) -> None:
        """Send a message that Zenoh does not drop, however long it takes to send."""
        key, blocks = self.transport.key(topic, HASH), zenoh.CongestionControl.BLOCK
        self.session.put(key, payload, congestion_control=blocks)

    def flood(self, topic: Interface, payload: bytes) -> None:
        """Send ``RATE_HZ`` messages a second, or as many as this machine can."""
        key, deadline_s = self.transport.key(topic, HASH), time.monotonic() + FLOOD_S
        publisher = self.session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
        while (begun_s := time.monotonic()) < deadline_s:
            for _ in range(RATE_HZ // 100):
                publisher.put(payload)
            time.sleep(max(0.0, begun_s + 0.01 - time.monotonic()))
        publisher.undeclare()


@contextmanager
def joined(endpoint: str) -> Iterator[zenoh.Session]:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        yield session


@pytest.fixture(scope="module", params=SIDES)
def beside(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Thing, Hostile]]:
    """Yield a robot in its fleet, and a hostile node beside it."""
    run, transport = SIDES[request.param]
    place = Place(tmp_path_factory.mktemp("fleet"))
    with ExitStack() as stack:
        endpoint = stack.enter_context(run())
        stack.enter_context(place.gateway())
        Liar(stack.enter_context(joined(endpoint)), transport)
        agent = stack.enter_context(process(*_agent(place, f"{request.param}:{endpoint}")))
        fleet = stack.enter_context(Fleet(place.root))
        eventually(lambda: joint_angle(fleet, "arm/pan") is not None, "the position of a joint")
        eventually(lambda: _bad_messages(fleet["arm"]) is not None, "the component driver")
        yield fleet["arm"], Hostile(stack.enter_context(joined(endpoint)), transport, agent)


def _agent(place: Place, address: str) -> tuple[str, ...]:
    options = f"stale=5&expose=/lamp&expose={TRAP}&expose={RIDDLES}/*&types={SOURCES}/interfaces_of_tests&distro=kilted"
    return "-m", "linked_fleet_agent", f"--robot=arm={address}?{options}", "--connect", place.zenoh


def _bad_messages(arm: Thing) -> float | None:
    found: float | None = arm["driver"].properties["badMessages"].value.number
    return found


def _resident_mib(process: Process) -> int:
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(status.partition("VmRSS:")[2].split()[0]) // 1024


def _goes_on(arm: Thing) -> None:
    """The joints move, and a stop works."""
    for angle in (0.3, 0.1):
        assert end_of(begin(arm["pan"].actions["rotate"], value=angle, unit="rad"))[:2] == ("succeeded", "")
        await_angle(arm, "pan", angle, within=0.02)
    assert end_of(arm.actions["stop"]()).state == "succeeded"
    assert arm.presence == "online"


def _state(name: str, *values: float) -> bytes:
    return TYPES.message(STATES.type).write({"name": [name] * len(values), "position": list(values)})


def _text(text: str) -> bytes:
    return TYPES.message(DESCRIPTION.type).write({"data": text})


MALFORMED = {
    "nothing": b"",
    "half a head": HEAD[:2],
    "truncated": HEAD + b"\x01",
    "2^32 items": HEAD + b"\x01\x00\x00\x00\x02\x00\x00\x00" + b"\xff" * 32,
    "16 MiB": HEAD + bytes(16 * 2**20),
    "another encoding": b"\xff\xff\xff\xff" + bytes(64),
}


@pytest.mark.parametrize("what", MALFORMED)
def test_malformed_messages_are_counted_and_the_robot_goes_on(beside: tuple[Thing, Hostile], what: str) -> None:
    arm, hostile = beside
    before, used = _bad_messages(arm) or 0.0, _resident_mib(hostile.agent)
    for topic in TOPICS:
        for _ in range(5):
            hostile.put(topic, MALFORMED[what])
    eventually(lambda: (_bad_messages(arm) or 0.0) > before, "bad messages are counted")
    _goes_on(arm)
    assert _resident_mib(hostile.agent) - used < MOST_MIB


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), 1e300])
def test_positions_of_a_joint_that_are_no_positions_leave_the_others_alone(
    beside: tuple[Thing, Hostile], value: float
) -> None:
    arm, hostile = beside
    for _ in range(20):
        hostile.put(STATES, _state("finger", value))
        hostile.put(STATES, _state("stranger", value, value))
    _goes_on(arm)


@pytest.mark.parametrize("topic", [STATES, BATTERY, LAMP], ids=lambda topic: topic.name)
def test_a_flood_costs_its_topic_alone(beside: tuple[Thing, Hostile], topic: Interface) -> None:
    arm, hostile = beside
    payloads = {STATES: _state("stranger", 0.5), LAMP: HEAD + b"\x01"}
    payload = payloads.get(topic) or TYPES.message(topic.type).write({"percentage": 0.5})
    used, flooding = _resident_mib(hostile.agent), threading.Thread(target=partial(hostile.flood, topic, payload))
    flooding.start()
    try:
        assert end_of(begin(arm["lift"].actions["rotate"], value=0.2, unit="rad"))[:2] == ("succeeded", "")
        assert arm.presence == "online"
    finally:
        flooding.join()
    _goes_on(arm)
    assert end_of(begin(arm["lift"].actions["rotate"], value=0.0, unit="rad")).state == "succeeded"
    assert _resident_mib(hostile.agent) - used < MOST_MIB


DESCRIPTIONS: dict[str, Callable[[], str]] = {
    "8 MB": lambda: f"<robot name='a'>{'<x/>' * 1_900_000}</robot>",
    "deep": lambda: "<robot name='a'>" + "<b>" * 1_000_000 + "</b>" * 1_000_000 + "</robot>",
    "billion laughs": lambda: (
        '<!DOCTYPE r [<!ENTITY a0 "ha">'
        + "".join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 10))
        + "]><robot name='a'>&a9;</robot>"
    ),
}


@pytest.mark.parametrize("what", DESCRIPTIONS)
def test_a_hostile_description_is_a_fault_until_the_good_one_comes_again(
    beside: tuple[Thing, Hostile], what: str
) -> None:
    arm, hostile = beside
    used = _resident_mib(hostile.agent)
    hostile.put(DESCRIPTION, _text(DESCRIPTIONS[what]()))
    eventually(lambda: "which is refused" in _fault(arm), "the fault")
    assert _resident_mib(hostile.agent) - used < MOST_MIB
    good = _text(URDF.read_text(encoding="utf-8"))

    def heals() -> bool:
        hostile.put(DESCRIPTION, good)
        return not _fault(arm)

    eventually(heals, "the robot is without a fault")
    _goes_on(arm)


def _fault(arm: Thing) -> str:
    return str(arm.read().graph.value(arm.node, LF.fault) or "")


def test_types_that_are_described_by_lies_are_left_out_with_the_reason(beside: tuple[Thing, Hostile]) -> None:
    arm, _ = beside
    with http_client(headers={"accept": "application/json"}) as http:
        missing = http.get(f"{arm.iri}driver/missing").text
    for name in OF_TYPES:
        assert f"{RIDDLES}/{name.lower()} is left out: the type strange_msgs/msg/{name} is not known" in missing, name
    assert not any(each.name == "riddle" for each in arm.parts)
    _goes_on(arm)


ENDS = {
    1: ("failed", "the encoding 0xffff is unknown"),
    2: ("failed", "/trap/_action/send_goal answered with 2097156 bytes; 1048576 is the maximum"),
    3: ("failed", "/trap/_action/send_goal answered with an error of Zenoh"),
    4: ("failed", "/trap does not answer"),
    5: ("failed", "what became of the goal is not known"),
    6: ("failed", "/trap does not know the goal any more"),
    7: ("succeeded", ""),
}


@pytest.mark.parametrize("order", ENDS)
def test_a_hostile_action_server_costs_its_goal_alone(beside: tuple[Thing, Hostile], order: int) -> None:
    """Answers that are none, too long, errors, silence, results that are none, and feedback without end."""
    arm, hostile = beside
    used = _resident_mib(hostile.agent)
    run = begin(arm["ros"].actions["trap"], order=order)
    assert end_of(begin(arm["lift"].actions["rotate"], value=0.1 * (order % 2), unit="rad"))[:2] == ("succeeded", "")
    end = end_of(run)
    state, said = ENDS[order]
    assert end.state == state and said in end.reason
    _goes_on(arm)
    assert _resident_mib(hostile.agent) - used < MOST_MIB


def test_thousands_of_tokens_are_bounded(beside: tuple[Thing, Hostile]) -> None:
    """The last test: router and robot themselves are too busy with them for messages to pass, also afterwards."""
    arm, hostile = beside
    if not isinstance(hostile.transport, RmwZenoh):
        pytest.skip("tokens of a bridge are its own")
    used, transport = _resident_mib(hostile.agent), hostile.transport
    tokens = [
        hostile.session.liveliness().declare_token(
            transport.token(number, "publisher", Interface(f"/noise_{number}", LAMP.type), HASH, KEEP_LAST_ONE)
        )
        for number in range(5000)
    ]
    eventually(lambda: arm.presence == "online", "the agent is there")
    assert _resident_mib(hostile.agent) - used < MOST_MIB
    for token in tokens:
        token.undeclare()
