"""Messages and tokens of the ROS side of a robot, passed to the functions of its driver, without session or threads."""

import json
import math
import struct
from collections.abc import Callable
from random import Random
from typing import Any

from fuzzing import mutation, ros2_types
from fuzzing.findings import Tally, in_process
from linked_fleet_agent.robot import Facts, RobotFaultError
from linked_fleet_agent.robots.ros2 import cdr
from linked_fleet_agent.robots.ros2.address import AddressError, parse_address
from linked_fleet_agent.robots.ros2.finding import facts_of
from linked_fleet_agent.robots.ros2.graph import ReceivedMessage
from linked_fleet_agent.robots.ros2.joints import JointStates, TrajectoryPoints
from linked_fleet_agent.robots.ros2.state_layouts import JointStateReader
from linked_fleet_agent.robots.ros2.transports import DdsBridge, RmwZenoh, Transport, is_bridge
from linked_fleet_agent.urdf import UrdfError, joints_of
from ros2_robot import STORE, URDF, joint_state, text
from ros_recording import RECORDING

_JOINTS = ("pan", "lift", "grip", "thumb_grip")
_WORDS = (0, 1, 2, 3, 4, 5, 7, 8, 1024, 1025, 65_536, 2**31 - 1, 2**31, 2**32 - 8, 2**32 - 1)
_HEADS = (b"\0\0\0\0", b"\0\1\0\0", b"\0\1\0\3", b"\0\2\0\0", b"\0\3\0\0", b"\0\7\0\0", b"\0\x0b\0\0", b"\1\0\0\0", b"")
_ADDRESS = "ros2:tcp/192.0.2.1:7447?domain=1&namespace=/a&states=b&commands=c:pan;lift&commands=/d/t:grip&stale=1.5"
_TOKENS = [
    token for said in json.loads(RECORDING.read_text(encoding="utf-8")).values() for token in said.get("tokens", ())
]
_TRANSPORTS: tuple[Transport, ...] = (RmwZenoh(0, "abc", "driver"), DdsBridge())
_PARTS = (
    "",
    "0",
    "MP",
    "MS",
    "SS",
    "SC",
    "AS",
    "NN",
    "%",
    "%a%b",
    "§",
    "a§b",
    "*",
    "**",
    "$*",
    "..",
    "é",
    "::,1:,:,:,,",
    "@ros2_lv",
)


def run(count: int, seed: int, first: int = 0) -> Tally:
    return in_process("ros2", count, seed, first, lambda: RosSide().take)


class RosSide:
    """The state of one robot's driver for one episode; its clock advances by 10 ms each time."""

    def __init__(self) -> None:
        self._reader = JointStateReader()
        self._states = JointStates("arm", joints_of(URDF), "/joint_states", 0.5)
        self._follower = TrajectoryPoints("/c/joint_trajectory", _JOINTS[:3])
        self._now_s = 0.0

    def take(self, random: Random) -> None:
        self._now_s += 0.01
        take: Callable[[RosSide, Random], None] = random.choices(_CASES, _WEIGHTS)[0]
        take(self, random)

    def state(self, random: Random) -> None:
        """Check that every reading has a value for each joint, and that ROS can read what is sent on."""
        payload = torn(random, _good_state(random))
        try:
            said = self._reader.read(payload)
        except cdr.CdrError:
            return
        assert repr(said) == repr(cdr.read_joint_state(payload)), "a known layout changes nothing"
        rows = (said.positions, said.velocities, said.efforts)
        assert all(len(row) == len(said.names) <= cdr.MAX_JOINTS for row in rows)
        self._states.update(said, self._now_s)
        try:
            reading = self._states.reading(self._now_s)
        except RobotFaultError:
            return
        for row in (reading.positions, reading.velocities, reading.efforts):
            assert len(row) == len(_JOINTS)
            assert not any(math.isinf(value) for value in row), "infinite is unknown"
        for name in reading.faults:
            assert math.isnan(reading.positions[_JOINTS.index(name)]), "a sensor that contradicts itself is unknown"
        self._send(random)

    def description(self, random: Random) -> None:
        """Pass a description of the robot's joints, or an invalid one."""
        urdf = URDF if random.random() < 0.5 else mutation.raw(random, URDF.encode()).decode("utf-8", "replace")
        payload = torn(random, text(urdf)) if random.random() < 0.3 else text(urdf)
        try:
            facts = facts_of("arm", ReceivedMessage(payload, 0.0))
        except (cdr.CdrError, UrdfError):
            return
        assert isinstance(facts, Facts) and 0 < len(facts.joints) <= cdr.MAX_JOINTS and len(facts.title) <= 256

    def address(self, random: Random) -> None:
        """Check that topic names with a special meaning in Zenoh are rejected."""
        said = mutation.raw(random, _ADDRESS.encode()).decode("utf-8", "replace")
        try:
            address = parse_address(said)
        except AddressError:
            return
        for name in (address.states, address.description, *(one.topic for one in address.controllers)):
            assert name.startswith("/") and not set(name) & set("*$?#% ") and "//" not in name, name

    def token(self, random: Random) -> None:
        """Check that whatever a token offers has a key of its transport that stands for nothing else."""
        token = _token(random)
        is_bridge(token)
        for transport in _TRANSPORTS:
            for offer in transport.offers_of(token):
                key = transport.key(offer.interface, offer.key_hash)
                assert key.split("/") and all(key.split("/")) and not set(key) & set("*$?#%§ "), key
                assert len(offer.interface.name) <= 255 and len(key) <= 1024, token

    def types(self, random: Random) -> None:
        """Pass a message, a description or a file of types, or a configuration."""
        take = random.choices(_OF_TYPES, _WEIGHTS_OF_TYPES)[0]
        take(random, torn)

    def _send(self, random: Random) -> None:
        setpoints = {name: random.uniform(-2, 2) for name in random.sample(_JOINTS[:3], random.randint(1, 3))}
        sent = self._follower.next(setpoints, self._now_s)
        payload = cdr.write_trajectory(list(sent), list(sent.values()), random.choice((0.05, 0.5)))
        read: Any = STORE.deserialize_cdr(payload, "trajectory_msgs/msg/JointTrajectory")
        assert read.joint_names == list(sent)
        assert all(math.isfinite(position) for position in read.points[0].positions)


def torn(random: Random, payload: bytes) -> bytes:
    """Return one in six unchanged; else with other lengths, encapsulation or bytes, or truncated."""
    how = random.randrange(6)
    if how == 0:
        return payload
    if how < 3:
        changed = bytearray(payload)
        at = 4 + 4 * random.randrange(max(1, len(payload) // 4 - 1))
        if at + 4 <= len(changed):
            struct.pack_into(random.choice("<>") + "I", changed, at, random.choice(_WORDS))
        return bytes(changed)
    if how == 3:
        return random.choice(_HEADS) + payload[4:]
    return payload[: random.randrange(len(payload) + 1)] if how == 4 else mutation.raw(random, payload)


def _token(random: Random) -> str:
    """Return a token that was recorded, or one with other parts, or mutated."""
    token: str = random.choice(_TOKENS)
    how = random.randrange(4)
    if how == 0:
        return token
    if how == 1:
        return mutation.raw(random, token.encode()).decode("utf-8", "replace")
    parts = token.split("/")
    for _ in range(random.randint(1, 3)):
        parts[random.randrange(len(parts))] = random.choice(
            (*_PARTS, random.choice(parts), "x" * random.choice((64, 300, 2000)))
        )
    return "/".join(parts)


def _good_state(random: Random) -> bytes:
    names = random.sample((*_JOINTS, "wheel", "é", ""), random.randint(0, 7)) or [str(n) for n in range(1200)]
    rows = ([_number(random) for _ in names] if random.random() < 0.8 else [] for _ in range(3))
    positions, velocities, efforts = rows
    stamp_ns, little_endian = random.choice((0, 1, random.getrandbits(50))), random.random() < 0.5
    return joint_state(names, positions, velocities, efforts, stamp_ns, little_endian)


def _number(random: Random) -> float:
    return random.choice((random.uniform(-2, 2), 0.0, -0.0, math.nan, math.inf, -math.inf, 1e308, 5e-324))


_CASES: tuple[Callable[[RosSide, Random], None], ...] = (
    RosSide.state,
    RosSide.types,
    RosSide.description,
    RosSide.address,
    RosSide.token,
)
_WEIGHTS = (45, 30, 10, 5, 10)
_OF_TYPES = (ros2_types.message, ros2_types.description, ros2_types.interface_file, ros2_types.configuration)
_WEIGHTS_OF_TYPES = (60, 25, 10, 5)
