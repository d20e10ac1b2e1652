"""A motion that arrives while shapes are being prepared waits for them, and for nothing else."""

import asyncio
import hashlib
import re
from asyncio.subprocess import Process
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from floor_maps import FREE, UNKNOWN, WALL, pgm, yaml
from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import Description, Mesh, Move, State
from linked_fleet_gateway.actions.plan import TIME_TO_LIVE_NS, Motion, RobotTime, build_command
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.world import checks, nearby
from linked_fleet_gateway.extensions.world.checks import Checks
from linked_fleet_gateway.extensions.world.collisions import Collides, Unchecked, UncheckedLinks
from linked_fleet_gateway.extensions.world.floor_map import ID, FloorMap
from linked_fleet_gateway.extensions.world.map_image import build_map
from linked_fleet_gateway.extensions.world.map_yaml import read_yaml
from linked_fleet_gateway.extensions.world.messages import Answer, Prepare, PrepareMesh, Question
from linked_fleet_gateway.extensions.world.placement import PLACEMENT, placement_of
from linked_fleet_gateway.extensions.world.scene import Box, Held, SceneObject, Sphere
from linked_fleet_identity.rights import ALL, View
from linked_fleet_link.fleet_link import NoAnswer
from linked_fleet_runtime.questions import QuestionProcess
from linked_fleet_runtime.worker import Worker
from linked_fleet_state.events import Appeared, Described, DescriptionRejected, Framed, Vanished
from linked_fleet_state.model import Pose
from linked_fleet_state.robot import Robot
from linked_fleet_state.unchecked import Finding, UncheckedLink
from meshes import channel, stl
from virtual.zenoh_network import ZenohNetwork

PATIENCE_S = 30.0
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
IN_THE_WAY = msgspec.json.encode(Pose((-0.1, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0))).decode()
"""The placement of a robot into which another one at the origin would turn."""


@pytest.fixture(autouse=True)
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine takes longer than the limits to start the process."""
    monkeypatch.setattr(nearby, "EARLY_S", PATIENCE_S)
    monkeypatch.setattr(checks, "_TIMEOUT_S", PATIENCE_S)


def content(name: str) -> bytes:
    return name.encode().ljust(80) + stl(channel())[80:]


class Scene:
    """Robots with a mesh that they serve only when permitted, and the checks of their motions."""

    def __init__(self, folder: Path, idle_s: float = Worker.IDLE_S) -> None:
        self.live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
        self.objects: dict[str, SceneObject] = {}
        self.maps: dict[str, FloorMap] = {}
        self.checks = Checks(self.live, Meshes(self._ask), self.objects, folder, idle_s=idle_s, maps=self.maps)
        self.asked: dict[str, asyncio.Event] = {}
        self.let: dict[str, asyncio.Event] = {}
        self.silent: set[str] = set()
        self.broken: set[str] = set()

    async def _ask(self, robot: str, mesh: Mesh, timeout_s: float) -> bytes:
        self.asked[robot].set()
        await self.let[robot].wait()
        if robot in self.silent:
            raise NoAnswer("it says nothing")
        return b"\0" * 200 if robot in self.broken else content(robot)

    def robot(self, name: str, x: float = 0.0, let: bool = False, mesh: str = "u.stl", **record: object) -> Robot:
        """Add a rod that rotates above a channel; all robots look different."""
        self.asked[name], self.let[name] = asyncio.Event(), asyncio.Event()
        if let:
            self.let[name].set()
        served = b"\0" * 200 if name in self.broken else content(name)
        digest = hashlib.sha256(served).hexdigest()
        offered = Mesh(uri="u.stl", sha256=digest, size=len(served), type="model/stl")
        urdf = (
            f"<robot name='{name}'><link name='foot'><collision><geometry><mesh filename='{mesh}'/></geometry>"
            f"</collision></link><link name='rod'><collision><origin xyz='0 .5 0'/><geometry><box size='.3 .02 .02'/>"
            f"</geometry></collision></link><joint name='turn' type='continuous'><parent link='foot'/>"
            f"<child link='rod'/><axis xyz='0 1 0'/></joint></robot>"
        )
        description = Description(
            version=1, robot=name, incarnation=1, title=name, urdf=urdf, joints=("turn",), rate_hz=100,
            capabilities=("move",), layout=layout(1, False), meshes=(offered,),
        )  # fmt: skip
        state = State(
            incarnation=1, sequence=1, monotonic_ns=1, wall_ns=1, positions=(0.0,), velocities=(0.0,), efforts=(0.0,)
        )
        for event in (Appeared(name, 1), Described(description), Framed(name, encode_state(state))):
            self.live.fleet.apply(event, 1)
        robot = self.live.fleet.robots[name]
        pose = {"position_m": (x, 0.0, 0.0), "orientation_xyzw": (0.0, 0.0, 0.0, 1.0)}
        robot.settings = {PLACEMENT: msgspec.json.encode(pose | record).decode()}
        return robot

    @property
    def worker(self) -> Worker:
        return self.checks._checker._process._worker

    async def idle(self) -> None:
        """Wait until the process has ended because it was idle."""
        await self.worker.process.wait()

    async def is_free(self, robot: Robot, sees: View = ALL) -> bool:
        return (await self.finding(robot, sees)).free

    async def finding(self, robot: Robot, sees: View = ALL) -> Finding:
        motion = Motion(robot, Move({"turn": 1.0}), {"turn": 1.0}, RobotTime(1, 1))
        return await self.checks.check_path(motion, sees, "")


@asynccontextmanager
async def scene_in(folder: Path, idle_s: float = Worker.IDLE_S) -> AsyncIterator[Scene]:
    made = Scene(folder, idle_s)
    async with made.checks:
        yield made
        for each in made.let.values():
            each.set()


async def test_a_motion_waits_for_the_shapes_of_its_robot(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("early")
        waiting = asyncio.create_task(scene.checks.wait_until_ready(robot, ALL))
        await scene.asked["early"].wait()
        assert not waiting.done() and not scene.checks.prepared
        scene.let["early"].set()
        await waiting
        assert scene.checks.prepared and await scene.is_free(robot)


async def test_a_motion_waits_for_shapes_until_the_limit_and_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(nearby, "EARLY_S", 0.01)
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("early")
        with pytest.raises(Unchecked) as refused:
            await scene.checks.wait_until_ready(robot, ALL)
        assert (refused.value.status, refused.value.headers["Retry-After"]) == (503, "2")
        monkeypatch.setattr(nearby, "EARLY_S", PATIENCE_S)
        scene.let["early"].set()  # what was begun has continued
        await scene.checks.wait_until_ready(robot, ALL)
        assert await scene.is_free(robot)


async def test_a_motion_beyond_those_that_wait_is_unchecked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By an error of a guard, which ends its invocation."""
    monkeypatch.setattr(checks, "MOST_WAITING", 1)
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("early")
        first = asyncio.create_task(scene.is_free(robot))
        await scene.asked["early"].wait()
        with pytest.raises(Unchecked, match="1 motions are being checked"):
            await scene.is_free(robot)
        scene.let["early"].set()
        assert await first


async def test_a_robot_that_joins_far_away_makes_its_own_motions_wait_alone(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        here, _ = scene.robot("here", let=True), scene.robot("there", x=30.0)
        await scene.asked["there"].wait()
        await scene.checks.wait_until_ready(here, ALL)
        assert await scene.is_free(here) and not scene.checks.prepared


async def test_a_robot_that_could_be_met_is_waited_for(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        here, _ = scene.robot("here", let=True), scene.robot("beside", x=1.0)
        waiting = asyncio.create_task(scene.checks.wait_until_ready(here, ALL))
        await scene.asked["beside"].wait()
        assert not waiting.done()
        scene.let["beside"].set()
        await waiting


async def test_what_a_robot_holds_meets_what_its_links_do_not(tmp_path: Path) -> None:
    """Until its link is not there any more, when nothing is known to be free."""
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("here", let=True)
        post, bar = Pose((0.7, 0.5, -0.38), UPRIGHT), Pose((0.5, 0.5, 0.0), UPRIGHT)
        scene.objects["post"] = SceneObject(title="post", kind="obstacle", pose=post, geometry=Sphere(0.05))
        assert await scene.is_free(robot)
        thing = SceneObject(title="bar", kind="obstacle", pose=post, geometry=Box((1.0, 0.02, 0.02)))
        scene.objects["bar"] = replace(thing, held=Held("here", "rod", bar))
        with pytest.raises(Collides) as refused:
            await scene.is_free(robot)
        assert str(refused.value.detail).startswith("bar, which rod of here holds, would meet post (obstacle)")
        assert refused.value.things == ["/world/objects/bar", "/world/objects/post"]
        assert refused.value.reason.startswith("what rod holds would meet an obstacle")
        scene.objects["bar"] = replace(thing, held=Held("here", "gone", bar))
        with pytest.raises(Unchecked, match="PUT bar anew"):
            await scene.is_free(robot)


async def test_a_robot_that_is_placed_beside_a_motion_during_its_check_is_not_overlooked(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("early")
        checking = asyncio.create_task(scene.is_free(robot))
        await scene.asked["early"].wait()
        beside = scene.robot("beside", let=True)
        beside.settings[PLACEMENT] = IN_THE_WAY
        scene.let["early"].set()
        with pytest.raises(Unchecked, match="The shape of beside"):
            await checking
        await scene.checks.wait_until_ready(robot, ALL)
        with pytest.raises(Collides, match="of beside"):
            await scene.is_free(robot)


async def test_a_robot_whose_description_is_rejected_during_a_check_makes_the_motion_unchecked(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        robot, _ = scene.robot("early"), scene.robot("beside", x=1.0, let=True)
        checking = asyncio.create_task(scene.is_free(robot))
        await scene.asked["early"].wait()
        for event in (Vanished("beside", 1), Appeared("beside", 2), DescriptionRejected("beside", 2, "it is none")):
            scene.live.fleet.apply(event, 1)
        scene.let["early"].set()
        with pytest.raises(Unchecked, match="The shape of beside is unknown"):
            await checking


async def test_a_robot_without_a_usable_description_stops_no_motion_far_away(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        robot, far = scene.robot("here", let=True), scene.robot("far", x=30.0)
        for event in (Vanished("far", 1), Appeared("far", 2), DescriptionRejected("far", 2, "it is none")):
            scene.live.fleet.apply(event, 1)
        assert far.model is None
        await scene.checks.wait_until_ready(robot, ALL)
        assert await scene.is_free(robot)


@pytest.mark.parametrize("record", ["", "{}", '{"position_m": [0, 0], "orientation_xyzw": [0, 0, 0, 1]}', "[1e999]"])
async def test_a_placement_that_cannot_be_read_is_unknown_and_stops_no_preparation(
    tmp_path: Path, record: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Its robot may be anywhere, so motions of all placed robots are unchecked, and are told which record it is."""
    async with scene_in(tmp_path) as scene:
        bad, good = scene.robot("bad", let=True), scene.robot("good", let=True)
        bad.settings[PLACEMENT] = record
        await scene.asked["good"].wait()  # by the look at all robots
        await scene.checks.wait_until_ready(good, ALL)
        assert scene.checks.prepared and placement_of(bad) is None
        for robot in (bad, good):
            await scene.checks.wait_until_ready(robot, ALL)
            with pytest.raises(Unchecked, match="placement of bad cannot be read"):
                await scene.is_free(robot)
        with pytest.raises(Unchecked, match="placement of another robot cannot be read"):
            await scene.is_free(good, View.of(frozenset({"good"}), "somebody"))
        bad.settings = {}
        assert await scene.is_free(good)
        assert [each.getMessage() for each in caplog.records].count(
            f"the placement of bad cannot be read: {record!r}"
        ) == 1


async def test_a_collision_with_an_invisible_robot_does_not_tell_its_place(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        robot, beside = scene.robot("here", let=True), scene.robot("beside", let=True)
        beside.settings[PLACEMENT] = IN_THE_WAY
        await scene.checks.wait_until_ready(robot, ALL)
        with pytest.raises(Collides, match="of beside") as whole:
            await scene.is_free(robot)
        with pytest.raises(Collides, match="would meet another robot") as part:
            await scene.is_free(robot, View.of(frozenset({"here"}), "somebody"))
        assert whole.value.point is not None and part.value.point is None
        assert len(part.value.things) == len(part.value.names) == 1


def floor(*rows: Sequence[int], height_m: float = 2.0) -> FloorMap:
    """Return a map with its lower left corner at (-0.5, 0.3), in cells of 0.5 m."""
    settings, _ = read_yaml(yaml(0.5, (-0.5, 0.3, 0.0)))
    return build_map(settings, pgm(rows), title="Hall 2", height_m=height_m, client="ann")


async def test_a_wall_of_the_map_is_an_obstacle_that_the_refusal_names_with_its_place(tmp_path: Path) -> None:
    """The rod is just above the wall and turns down into it. Unknown cells, and lower walls, are no obstacles."""
    above = {"position_m": (0.0, 0.0, 2.05)}
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("here", let=True, **above)
        await scene.checks.wait_until_ready(robot, ALL)
        for free in (floor([UNKNOWN, UNKNOWN]), floor([WALL, WALL], height_m=1.5), floor([FREE, WALL], [FREE, FREE])):
            scene.maps[ID] = free
            assert await scene.is_free(robot)
        scene.maps[ID] = floor([FREE, WALL])
        with pytest.raises(Collides) as refused:
            await scene.is_free(robot)
        said = refused.value
        assert re.search(
            r"rod of here would meet an occupied place of Hall 2 \(map of the floor\)"
            r" at x 0\.\d\d m, y 0\.(?:49|5\d) m",
            said.detail,
        )
        assert said.things == ["/here/rod", "/world/map"] and said.point is not None
        assert said.names == ["rod of here", "Hall 2 (map of the floor)"]
        assert said.reason.startswith("rod would meet an occupied place of the map of the floor")
        del scene.maps[ID]
        assert await scene.is_free(robot)


async def test_a_map_is_prepared_again_by_a_new_process_and_after_another_map(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("here", let=True, position_m=(0.0, 0.0, 2.05))
        wall, nothing = floor([FREE, WALL]), floor([FREE, FREE])
        for found in (wall, nothing, wall):
            scene.maps[ID] = found
            if found is nothing:
                assert await scene.is_free(robot)
                continue
            with pytest.raises(Collides, match="Hall 2"):
                await scene.is_free(robot)
            scene.worker.process.kill()
            await scene.idle()


async def test_links_that_no_check_covers_are_refused_near_a_wall(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("here", let=True, mesh="absent.stl")
        await scene.checks.wait_until_ready(robot, ALL)
        assert await scene.is_free(robot)
        scene.maps[ID] = floor([FREE, WALL])
        with pytest.raises(UncheckedLinks, match=r"may meet an occupied place of Hall 2 \(map of the floor\)"):
            await scene.is_free(robot)


async def test_unchecked_links_are_shown_logged_once_and_named_in_findings(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("gappy", mesh="none.stl")
        for _ in range(2):
            await scene.checks.wait_until_ready(robot, ALL)
            found = await scene.finding(robot)
        link = UncheckedLink("foot", "none.stl", "the agent does not offer it")
        assert robot.unchecked == (link,) and found == Finding(True, (("/gappy/foot", link),))
        logged = [each.getMessage() for each in caplog.records if "not checked" in each.getMessage()]
        assert logged == ["1 links of gappy are not checked: foot (none.stl: the agent does not offer it)"]


async def test_a_mesh_that_cannot_be_read_leaves_its_link_unchecked(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        scene.broken.add("odd")
        robot = scene.robot("odd", let=True)
        await scene.checks.wait_until_ready(robot, ALL)
        assert scene.checks.prepared
        assert [(each.link, each.reason) for each in robot.unchecked] == [("foot", "it cannot be read as stl")]


async def test_motions_beside_unchecked_links_are_refused_and_name_what_the_caller_may_see(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        robot, gappy = scene.robot("here", let=True), scene.robot("gappy", x=1.0, mesh="none.stl")
        for each in (robot, gappy):
            await scene.checks.wait_until_ready(each, ALL)
        with pytest.raises(UncheckedLinks, match=r"gappy that may meet here: foot .*placement of gappy") as whole:
            await scene.finding(robot)
        assert [path for path, _ in whole.value.unchecked] == ["/gappy/foot"] and "gappy" not in whole.value.reason
        with pytest.raises(UncheckedLinks, match="parts of another robot that may meet here") as part:
            await scene.finding(robot, View.of(frozenset({"here"}), "somebody"))
        assert part.value.members == {}
        with pytest.raises(UncheckedLinks, match="parts of gappy that may meet here: foot"):
            await scene.finding(gappy)


async def test_a_neighbour_whose_placement_accepts_its_unchecked_links_is_named(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("here", let=True)
        gappy = scene.robot("gappy", x=1.0, mesh="none.stl", accepts_unchecked=True)
        await scene.checks.wait_until_ready(robot, ALL)
        assert [path for path, _ in (await scene.finding(robot)).unchecked] == ["/gappy/foot"]
        assert (await scene.finding(robot, View.of(frozenset({"here"}), "somebody"))).unchecked == ()
        assert (await scene.finding(gappy)).free


@pytest.mark.parametrize("ends_in", ["prepare", "mesh"])
async def test_an_input_that_ends_the_process_makes_its_own_links_unchecked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ends_in: str
) -> None:
    """Motions of others go on. An answer that does not come stands for a process that ended."""
    exchange = QuestionProcess._exchange

    async def ends(process: QuestionProcess[Question, Answer], question: Question) -> Answer:
        deadly = isinstance(question, PrepareMesh) if ends_in == "mesh" else (
            isinstance(question, Prepare) and "deadly" in question.urdf and not question.unusable_robot)  # fmt: skip
        if deadly:
            raise EOFError("it ended")
        return await exchange(process, question)

    monkeypatch.setattr(QuestionProcess, "_exchange", ends)
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("deadly", let=True)
        for _ in range(4):
            await scene.checks.wait_until_ready(robot, ALL)
        assert scene.checks.prepared and {each.link for each in robot.unchecked} >= {"foot"}
        assert "ended several times" in robot.unchecked[0].reason
        other = scene.robot("other", x=5.0, mesh="", let=True)
        await scene.checks.wait_until_ready(other, ALL)
        assert (await scene.finding(other)).free


async def test_a_robot_without_usable_shapes_is_refused_and_delays_nobody(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("mute", let=True)
        scene.silent.add("mute")
        await scene.checks.wait_until_ready(robot, ALL)
        assert scene.checks.prepared
        with pytest.raises(Unchecked):
            await scene.is_free(robot)


async def test_a_robot_whose_agent_delivers_no_meshes_blocks_only_what_is_near_it(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        scene.silent.add("mute")
        mute, near, far = (
            scene.robot("mute", let=True),
            scene.robot("near", 1.0, let=True),
            scene.robot("far", 9.0, let=True),
        )
        for robot in (mute, near, far):
            await scene.checks.wait_until_ready(robot, ALL)
        assert {each.reason for each in mute.unchecked} == {"its agent does not deliver the meshes"}
        with pytest.raises(UncheckedLinks, match="parts of mute that may meet near"):
            await scene.finding(near)
        assert (await scene.finding(far)).free
        with pytest.raises(Unchecked):
            await scene.finding(mute)
        scene.silent.clear()
        await scene.checks.wait_until_ready(mute, ALL)
        assert mute.unchecked == () and (await scene.finding(near)).unchecked == ()


async def test_another_gateway_finds_the_shapes_on_disk_and_asks_no_robot(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        await scene.checks.wait_until_ready(scene.robot("arm", let=True), ALL)
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("arm")
        await scene.checks.wait_until_ready(robot, ALL)
        assert await scene.is_free(robot) and not scene.asked["arm"].is_set()


async def test_shapes_are_prepared_again_when_the_process_that_has_them_is_gone(tmp_path: Path) -> None:
    async with scene_in(tmp_path) as scene:
        robot = scene.robot("arm", let=True)
        await scene.checks.wait_until_ready(robot, ALL)
        process = scene.worker.process
        process.kill()
        await process.wait()
        assert not scene.checks.prepared
        await scene.checks.wait_until_ready(robot, ALL)
        assert await scene.is_free(robot)


async def test_the_process_ends_when_idle_and_the_next_motion_starts_it_again(tmp_path: Path) -> None:
    async with scene_in(tmp_path, idle_s=0.0) as scene:
        robot = scene.robot("arm", let=True)
        await scene.checks.wait_until_ready(robot, ALL)
        scene.asked["arm"].clear()
        for _ in range(2):
            await scene.idle()
            await scene.checks._preparation._look()
            assert scene.checks.prepared and not scene.worker.running, "nothing but a motion needs it"
            await scene.checks.wait_until_ready(robot, ALL)
            assert await scene.is_free(robot)
        assert not scene.asked["arm"].is_set(), "its shapes are on disk"


async def test_a_motion_waits_for_a_process_that_starts_slowly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit of a check counts from its question on."""
    async with scene_in(tmp_path, idle_s=0.0) as scene:
        robot = scene.robot("arm", let=True)
        await scene.checks.wait_until_ready(robot, ALL)
        await scene.idle()
        start = scene.worker.start

        async def start_slowly(*arguments: str, **pipes: Any) -> Process:
            await asyncio.sleep(0.3)
            monkeypatch.setattr(checks, "_TIMEOUT_S", PATIENCE_S)
            return await start(*arguments, **pipes)

        monkeypatch.setattr(scene.worker, "start", start_slowly)
        monkeypatch.setattr(checks, "_TIMEOUT_S", 0.1)
        assert await scene.is_free(robot)


async def test_a_robot_that_is_placed_after_the_process_became_idle_is_prepared_at_once(tmp_path: Path) -> None:
    async with scene_in(tmp_path, idle_s=0.0) as scene:
        await scene.checks.wait_until_ready(scene.robot("first", let=True), ALL)
        await scene.idle()
        second = scene.robot("second", x=1.0)
        assert not scene.checks.prepared
        await scene.asked["second"].wait()
        scene.let["second"].set()
        await scene.checks.wait_until_ready(second, ALL)
        assert scene.checks.prepared and await scene.is_free(second)


async def test_a_process_that_dies_after_it_was_idle_has_nothing_prepared(tmp_path: Path) -> None:
    async with scene_in(tmp_path, idle_s=0.0) as scene:
        robot = scene.robot("arm", let=True)
        await scene.checks.wait_until_ready(robot, ALL)
        await scene.idle()
        with scene.worker.in_use():
            await scene.checks.wait_until_ready(robot, ALL)
            process = scene.worker.process
            process.kill()
            await process.wait()
            assert not scene.checks.prepared


def test_waiting_for_a_check_does_not_make_a_motion_late_but_a_stop_overrides_it(tmp_path: Path) -> None:
    """A command is dated to its request: a robot that was stopped afterwards refuses it."""

    robot = Scene(tmp_path).robot("arm")
    command = build_command("id", Motion(robot, Move({"turn": 1.0}), {"turn": 1.0}, RobotTime(1, 17)), 3_000)
    assert (command.seen_ns, command.time_to_live_ns) == (17, TIME_TO_LIVE_NS + 3_000)
