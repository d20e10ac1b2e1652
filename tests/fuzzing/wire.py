"""Every message of the Zenoh protocol, in both directions, passed to the functions of link and agent."""

import itertools
import json
from collections.abc import Callable
from random import Random
from typing import Any
from uuid import UUID

from fuzzing import good, mutation
from fuzzing.body import AgentUnderTest
from fuzzing.findings import Tally, in_process
from linked_fleet_agent.mesh_files import MeshError
from linked_fleet_agent.robot import PictureError
from linked_fleet_agent.wire import traceparent
from linked_fleet_agent.wire.codec import (
    MAGICS,
    PictureHeader,
    WireError,
    decode,
    decode_reply,
    decode_state,
    encode_picture,
)
from linked_fleet_agent.wire.keys import Keys, escape, unescape
from linked_fleet_agent.wire.messages import Accepted, Camera, Mesh, PictureFormat, Progress, Reply
from linked_fleet_base.errors import FleetError
from linked_fleet_gateway.extensions.cameras.cameras import read_picture
from linked_fleet_gateway.extensions.models.meshes import read_mesh
from linked_fleet_gateway.extensions.pages.extension import Pages
from linked_fleet_gateway.http.representation import Representations
from linked_fleet_gateway.resources.paths import robot_path
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_state.answers import read_description, read_reply
from linked_fleet_state.events import Appeared, Described, DescriptionRejected, Framed, Vanished
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocation, Invocations

_REPRESENTATIONS = Representations(Pages())
_BASE = "http://127.0.0.1"
_KEYS = Keys()
_TYPES = ("text/turtle", "application/ld+json", "application/rdf+xml", "text/html")
_MESH = Mesh(uri="file:///x.stl", sha256="0" * 64, size=4, type="model/stl")
_EYE = Camera(name="eye", link="base", width=3, height=2, vertical_fov_rad=1.0, near_m=0.1, far_m=9.0)
_SEEN: dict[PictureFormat, bytes] = {
    "png": b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x00\x00\x00\x03\x00\x00\x00\x02\x08\x02\x00\x00\x00",
    "jpeg": b"\xff\xd8\xff\xe0\x00\x04ab\xff\xc0\x00\x0b\x08\x00\x02\x00\x03\x03",
    "depth": bytes(24),
}
_TRACE = b"00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"


def run(count: int, seed: int, first: int = 0) -> Tally:
    return in_process("wire", count, seed, first, lambda: World().take)


def spoilt(random: Random, document: Any) -> bytes:
    """Return one in eight unchanged: a later refusal must not be caused by an earlier valid message."""
    how = random.randrange(8)
    if how == 0:
        return mutation.dumped(document)
    if how < 6:
        return mutation.dumped(mutation.tree(random, document))
    return mutation.raw(random, mutation.dumped(document))


class World:
    """An agent, and the fleet of a gateway, for one episode."""

    def __init__(self) -> None:
        self._patient = AgentUnderTest()
        self._fleet, self._invocations = Fleet(), Invocations()
        self._sequence = itertools.count()
        self._runs = itertools.count(1)
        self._now_ns = 10**18
        for number in range(8):
            action = "/arm/actions/moveJoints"
            self._invocations.add(Invocation(str(UUID(int=number)), "arm", action, {"pan": 0.1}, 1, 2))
        for name in good.NAMES:
            self._appear(Random(len(name)), name)

    def take(self, random: Random) -> None:
        take: Callable[[World, Random], None] = random.choices(_CASES, _WEIGHTS)[0]
        take(self, random)

    # To the agent

    def command(self, random: Random) -> None:
        patient = self._patient
        made = good.command(random, patient.new_id(), patient.agent.incarnation, patient.now_ns)
        reply = _reply_of(patient.agent.handle(spoilt(random, made)))
        if isinstance(reply, Accepted) and random.random() < 0.5:
            patient.pass_ms(random.choice((1, 10, 10, 100, 1000)))
        patient.pass_ms(10)

    def stop(self, random: Random) -> None:
        patient = self._patient
        _reply_of(patient.agent.handle_stop(spoilt(random, good.stop(random, patient.new_id()))))
        patient.pass_ms(10)

    def mesh_question(self, random: Random) -> None:
        try:
            self._patient.agent.mesh(mutation.raw(random, b"0" * 64))
        except MeshError:
            return
        raise AssertionError("a robot without meshes handed one out")

    def glance(self, random: Random) -> None:
        asked = {"version": 1, "camera": "eye", "format": random.choice(tuple(MAGICS))}
        try:
            self._patient.agent.picture(spoilt(random, asked))
        except PictureError:
            return
        raise AssertionError("a robot without cameras saw something")

    # To the gateway

    def frame(self, random: Random) -> None:
        name = random.choice(good.NAMES)
        robot = self._fleet.robots[name]
        said = robot.description
        joints, floating = (len(said.joints), said.base == "floating") if said else (1, False)
        payload = good.frame(random, joints, floating, robot.incarnation or 0, next(self._sequence))
        if random.random() < 0.8:
            payload = torn(random, payload)
        self._apply(Framed(name, payload))
        self._look(random, name, 0.05)
        try:
            decode_state(payload)
        except WireError:
            return

    def description(self, random: Random) -> None:
        self._appear(random, random.choice(good.NAMES), bad=True)

    def progress(self, random: Random) -> None:
        id = str(UUID(int=random.randrange(9)))
        payload = spoilt(random, good.progress(random, id, 1))
        try:
            progress = decode(payload, Progress)
        except WireError:
            return
        self._invocations.apply("arm", progress)
        self._invocations.targets("arm", progress.incarnation)

    def reply(self, random: Random) -> None:
        payload = spoilt(random, good.reply(random, "a-1"))
        reply, reason = read_reply(payload, "a-1")
        assert (reply is None) == bool(reason), "an answer is either taken or told what is wrong"
        read_mesh(payload, _MESH)

    def picture(self, random: Random) -> None:
        format = random.choice(tuple(_SEEN))
        payload = encode_picture(format, PictureHeader(2, 3, 1, 1, 1, 1, 0.1, 9.0), _SEEN[format])
        taken, reason = read_picture(mutation.raw(random, payload), _EYE, format, 1)
        assert (taken is None) == bool(reason), "a picture is either taken or told what is wrong"
        assert taken is None or taken.moment[:3] == (2, 3, 1), "a picture of another size or run is not taken"

    def trace(self, random: Random) -> None:
        found = traceparent.parse(mutation.raw(random, _TRACE).decode("latin-1"))
        if found is not None:
            assert traceparent.parse(str(found)) == found, "a traceparent is read as it is written"

    def key(self, random: Random) -> None:
        name = random.choice((*good.NAMES, *mutation.TEXTS[:40]))
        kind = random.choice(("state", "command", "stop", "progress", "mesh", "picture", "description"))
        try:
            key = _KEYS.robot(name, kind) if random.random() < 0.6 else _KEYS.presence(name, random.getrandbits(63))
            parsed = _KEYS.parse(mutation.raw(random, key.encode()).decode("utf-8", "surrogateescape"))
        except ValueError:  # UnicodeEncodeError of an unpaired surrogate is a ValueError
            return
        assert unescape(escape(parsed.robot)) == parsed.robot, "a name has one spelling"

    def _appear(self, random: Random, name: str, bad: bool = False) -> None:
        run_ = next(self._runs)
        self._apply(Appeared(name, run_))
        said = good.description(random, name, run_)
        answer = spoilt_description(random, good.tree_of(said)) if bad else json.dumps(good.tree_of(said)).encode()
        description, reason = read_description(answer, name, (run_,))
        self._apply(DescriptionRejected(name, run_, reason) if description is None else Described(description))
        self._look(random, name, 0.25)
        self._apply(Vanished(name, run_ - 1 if random.random() < 0.9 else run_))

    def _apply(self, event: Any) -> None:
        self._now_ns += 1
        self._fleet.apply(event, self._now_ns)

    def _look(self, random: Random, name: str, share: float) -> None:
        """Read the robot as clients do, and its page with the probability ``share``."""
        robot = self._fleet.robots[name]
        robot.positions  # noqa: B018 (decoded on access)
        for link in list(robot.model.links if robot.model else ())[:3]:
            robot.link_pose(link)
        if random.random() >= share:
            return
        found = Tree(self._fleet, self._invocations, _BASE).resolve(robot_path(name))
        assert isinstance(found, Resource), "a robot that is known has a page"
        parts = [path for path in (*found.own_paths, *found.part_paths) if "/subscriptions" not in path]
        for path in (found.path, *random.sample(parts, min(2, len(parts)))):
            self._read(path, random.choice(_TYPES))

    def _read(self, path: str, media_type: str) -> None:
        part = Tree(self._fleet, self._invocations, _BASE).resolve(path)
        if not isinstance(part, Resource) or part.remote is not None:
            return
        try:
            _REPRESENTATIONS.negotiate(media_type, part, _BASE)
        except FleetError as error:
            assert error.status in (404, 406, 503), error


def _reply_of(payload: bytes) -> Reply:
    return decode_reply(payload)


def torn(random: Random, payload: bytes) -> bytes:
    """Mutate words of eight bytes, of which a frame consists."""
    if random.random() < 0.4:
        return mutation.raw(random, payload)
    changed = bytearray(payload)
    at = 8 * random.randrange(len(payload) // 8)
    words = (b"\0" * 8, b"\xff" * 8, b"\0" * 6 + b"\xf8\x7f", b"\0" * 6 + b"\xf0\x7f", b"\xff" * 7 + b"\x7f")
    changed[at : at + 8] = random.choice((*words, random.randbytes(8)))
    return bytes(changed)


def spoilt_description(random: Random, document: dict[str, Any]) -> bytes:
    """Mutate a description; half of the mutations are in its URDF."""
    if random.random() < 0.5:
        urdf = str(document["urdf"])
        if random.random() < 0.5:
            document["urdf"] = mutation.raw(random, urdf.encode()).decode("utf-8", "replace")
        else:
            document["urdf"] = _attributes(random, urdf)
        return mutation.dumped(document)
    return spoilt(random, document)


_VALUES = (
    "", "0", "-1", "1e400", "nan", "inf", "1 2", "0 0 0", "0 0 1e-300", "1e308 1e308 1e308", "x", "pan", "base",
    "tip", "fixed",
    "floating", "planar", "prismatic", "continuous", "é", "x" * 200, "..", "&#0;", "&amp;", "pose",
)  # fmt: skip


def _attributes(random: Random, urdf: str) -> str:
    """Replace the values of one to three attributes, or of all with one name."""
    for _ in range(random.choice((1, 1, 2, 3))):
        pieces = urdf.split('"')
        at = 2 * random.randrange(len(pieces) // 2) + 1
        pieces[at] = random.choice((*_VALUES, random.choice(pieces[1::2])))
        urdf = '"'.join(pieces)
    return urdf


_CASES = (
    World.command, World.stop, World.mesh_question, World.frame, World.description, World.progress, World.reply,
    World.trace, World.key, World.glance, World.picture,
)  # fmt: skip
_WEIGHTS = (26, 12, 2, 20, 8, 10, 8, 6, 8, 2, 8)
