"""``python -m linked_fleet_demo.contacts``: stops simulated robots that have moved into something.

Each agent simulates its robot alone. This process puts all robots of the demo, the objects of the world and what robots
hold into one MuJoCo model, follows the frames of the robots, and causes a protective stop of each that touches
something, as robots do that feel a contact.
"""

import argparse
import asyncio
import contextlib
import logging
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import cache
from http.client import HTTPException

from linked_fleet_agent.mesh_files import mesh_files
from linked_fleet_agent.robots.catalogue import MODELS, data_folder, facts_of, urdf_of
from linked_fleet_agent.robots.contact_model import ContactModel, ContactRobot, Triangles
from linked_fleet_agent.urdf import RobotModel, decode
from linked_fleet_agent.urdf.joints import JointKind
from linked_fleet_agent.urdf.poses import Pose
from linked_fleet_agent.wire.codec import WireError, decode_state
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.messages import State
from linked_fleet_agent.zenoh_session import open_session
from linked_fleet_demo.contact_watch import ContactWatch
from linked_fleet_demo.world_reader import World, WorldReader

_LOOK_S, _READ_S = 0.05, 0.5
_MOVED, _MOVED_M = 1e-3, 5e-4
"""A robot moves whose joints (rad or m) or base (m) move further than this between two looks."""
_MOST_FRAME_BYTES = 1 << 16
_NICE = 5
log = logging.getLogger(__name__)

Frames = Mapping[str, Callable[[], bytes | None]]
"""By robot, what returns its newest frame, None if there is none since the last call."""


class Contacts:
    """Contacts of robots of the catalogue with each other and with objects, as the gateway at ``root`` knows them."""

    def __init__(self, root: str, robots: Sequence[str]) -> None:
        self._reader, self._watch = WorldReader(root, _surface), ContactWatch()
        self._robots = {name: contact_robot(name) for name in robots}
        self._states: dict[str, State] = {}
        self._world, self._placed = World({}, ()), set[str]()
        self._model: ContactModel | None = None
        self._looks = False
        """True if contacts are to be looked for although nothing moves: the world is another one, or a robot stops."""

    def read(self) -> None:
        """Read the world, and make the model anew if it has changed. Raises OSError, HTTPException."""
        world = self._reader.read()
        if world is self._world:
            return
        self._world, self._looks = world, True
        self._placed = world.placements.keys() & self._robots.keys()
        robots = [each for name, each in self._robots.items() if name in self._placed]
        here = [each for each in world.objects if each.held is None or each.held.robot in self._placed]
        try:
            self._model = ContactModel(robots, here)
        except ValueError as error:
            self._model = None
            log.warning("contacts are not seen, because MuJoCo cannot use an object of the world: %s", error)
        for name in self._placed & self._states.keys():
            self._put(name)

    def look(self, now_s: float, frames: Frames) -> None:
        """Stop each robot that has moved into something."""
        moving = {name for name in self._placed if self._moves(name, frames[name]())}
        if self._model is None or not (moving or self._looks):
            return
        self._looks = bool(moving)
        for each in self._watch.collisions(self._model.contacts(), moving, now_s):
            log.warning("%s is stopped: %s", each.robot, each.what)
            try:
                self._reader.stop(each.robot, f"contact: {each.what}")
            except (OSError, HTTPException) as error:
                log.warning("%s could not be stopped: %s", each.robot, error)
                self._watch.not_stopped(each)

    def _moves(self, name: str, frame: bytes | None) -> bool:
        """Put a robot where a frame says. Return True if it has moved since the last look."""
        before = self._states.get(name)
        if frame is None:
            return False
        try:
            state = self._states[name] = decode_state(frame)
        except WireError:
            return False
        self._put(name)
        return before is not None and _differ(before, state)

    def _put(self, name: str) -> None:
        if self._model is not None:
            state = self._states[name]
            base = None if state.base is None else Pose(state.base.position_m, state.base.orientation_xyzw)
            self._model.place(name, self._world.placements[name], state.positions, base)


def contact_robot(name: str) -> ContactRobot:
    """Return a robot of the catalogue. Raises UnavailableError, OSError, UrdfError."""
    model = MODELS[name]
    file = data_folder() / model.file
    facts = facts_of(model, urdf_of(model, decode(file.read_bytes(), f"{name}: {file.name}"), name))
    files = mesh_files(facts.urdf, file)

    @cache
    def mesh_of(uri: str) -> Triangles | None:
        path = files.get(uri)
        return None if path is None else _surface(path.read_bytes(), path.suffix[1:].lower())

    made = ContactRobot.made(name, facts.urdf, [each.name for each in facts.joints], mesh_of, _hand(name, facts.urdf))
    if made.unused:
        log.warning("%s: a mesh of %s is not read: contacts of it are not seen", name, ", ".join(made.unused))
    return made


def _hand(name: str, urdf: str) -> frozenset[str]:
    """Return the links that may touch objects: of grippers, or what the last joint of an arm without one carries."""
    parts, tree = MODELS[name].parts, RobotModel.for_urdf(urdf)
    if parts.fingers:
        moved = [joint for part in parts.fingers for joint in part.joints]
        return frozenset({*(part.link for part in parts.fingers), *(tree.joints[each].child for each in moved)})
    if parts.base is not None or parts.legs is not None:
        return frozenset()
    fixed = {each.child: each.parent for each in tree.joints.values() if each.kind is JointKind.FIXED}
    ends = tree.links.keys() - {
        _carrier(each.parent, fixed) for each in tree.joints.values() if each.child not in fixed
    }
    return frozenset(link for link in tree.links if _carrier(link, fixed) in ends)


def _carrier(link: str, fixed: Mapping[str, str]) -> str:
    """Return the link to which another one is fixed, which a joint moves."""
    while link in fixed:
        link = fixed[link]
    return link


def _surface(content: bytes, suffix: str = "stl") -> Triangles | None:
    from linked_fleet_gateway.extensions.world.surfaces import read_mesh
    from linked_fleet_state.xml import ModelError

    try:
        found = read_mesh(suffix, content)
    except ModelError:
        return None
    return found.vertices, found.triangles


def _differ(one: State, other: State) -> bool:
    bases = one.base, other.base
    if bases[0] is not None and bases[1] is not None:
        if math.dist(bases[0].position_m, bases[1].position_m) > _MOVED_M:
            return True
        if math.dist(bases[0].orientation_xyzw, bases[1].orientation_xyzw) > _MOVED:
            return True
    return any(abs(a - b) > _MOVED for a, b in zip(one.positions, other.positions, strict=False))


async def watch(contacts: Contacts, robots: Sequence[str], connect: str, namespace: str) -> None:
    """Follow the robots until cancelled."""
    keys, read_s = Keys(namespace), -math.inf
    async with open_session((connect,)) as session:
        with ExitStack() as stack:
            frames = {
                name: stack.enter_context(session.latest_payload(keys.robot(name, "state"), _MOST_FRAME_BYTES))
                for name in robots
            }
            while True:
                with contextlib.suppress(OSError, HTTPException):  # the gateway is busy, or ends; next time
                    if time.monotonic() - read_s > _READ_S:
                        await asyncio.to_thread(contacts.read)
                        read_s = time.monotonic()
                    await asyncio.to_thread(contacts.look, time.monotonic(), frames)
                await asyncio.sleep(_LOOK_S)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m linked_fleet_demo.contacts", description=__doc__)
    parser.add_argument("--url", required=True, help="root of the gateway")
    parser.add_argument("--connect", required=True, help="Zenoh endpoint of the gateway")
    parser.add_argument("--namespace", required=True)
    parser.add_argument("robots", nargs="+", choices=list(MODELS))
    asked = parser.parse_args()
    logging.basicConfig(format="%(asctime)s %(levelname)s %(message)s")
    os.nice(_NICE)
    asyncio.run(watch(Contacts(asked.url, asked.robots), asked.robots, asked.connect, asked.namespace))


if __name__ == "__main__":
    main()
