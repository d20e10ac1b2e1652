"""The policy of the fan-out, on a real fleet and tree: what is news, what is conflated, and what comes last."""

import asyncio
import itertools
import random
from typing import Any

import pytest

from fan_out_world import (
    JOINT,
    OTHER_URDF,
    ROBOT,
    ROTATION,
    InStep,
    Outlet,
    World,
    begin,
    begin_many,
    change_options,
    described,
    limit_turn,
    watch,
)
from linked_fleet_gateway.resources.subscription import Depth
from linked_fleet_gateway.subscriptions import fan_out
from linked_fleet_gateway.subscriptions.broadcast import Ending, Message
from linked_fleet_gateway.subscriptions.topic import Topic
from linked_fleet_identity.rights import View
from linked_fleet_state.events import Appeared, Described, DescriptionRejected, Event, Framed, Vanished
from linked_fleet_state.invocations import Invocation, InvocationState

pytestmark = pytest.mark.usefixtures("outlet_kinds")


async def test_every_change_is_a_message_when_there_is_room() -> None:
    """First the present state; each message names the version before it; no value within its resolution is one."""
    world = await World().up()
    outlet = watch(world, ROTATION)
    assert not outlet.messages, "nothing is written before somebody is ready"
    outlet.watcher.schedule_send()
    await world.settle()
    await world.move(0.0, 0.1, 0.1, 0.100004, 0.099996, 0.1, 0.2)
    assert outlet.versions[1:] == ["1-3", "1-8"]
    assert outlet.previous == [None, *outlet.versions[:-1]]


async def test_a_full_outlet_gets_the_latest_and_sees_the_gap() -> None:
    """Values are conflated while there is no room, nobody else waits, and the last one goes out."""
    world = await World().up()
    slow, fast = watch(world, ROTATION), watch(world, ROTATION)
    slow.watcher.schedule_send(), fast.watcher.schedule_send()
    await world.settle()
    slow.room = False
    await world.move(0.1, 0.2, 0.3)
    assert (len(slow.messages), len(fast.messages)) == (1, 4)
    slow.room = True
    slow.watcher.schedule_send()
    await world.settle()
    assert slow.messages[-1] is fast.messages[-1], "rendered once"
    assert len(slow.messages) == 2
    assert slow.previous[-1] == fast.versions[-2] != slow.versions[0]


async def test_a_value_that_returned_to_the_sent_one_is_no_news() -> None:
    world = await World().up()
    outlet = await begin(world, ROTATION)
    outlet.room = False
    await world.move(0.1, 0.0)
    outlet.room = True
    outlet.watcher.schedule_send()
    await world.settle()
    assert len(outlet.messages) == 1
    await world.move(0.3)
    assert len(outlet.messages) == 2


async def test_a_burst_of_frames_is_read_once() -> None:
    """Frames that arrive together are not queued: the latest is read, and the gap is shown."""
    world = await World().up()
    outlet = await begin(world, ROTATION)
    await world.apply(*(world.frame(angle) for angle in (0.1, 0.2, 0.3)))
    assert len(outlet.messages) == 2
    assert b"0.3" in outlet.messages[-1].body


async def test_frames_of_many_robots_are_marked_in_several_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread that stores frames wakes the fan-out once; who hears of all frames delays nobody else."""
    limit_turn(monkeypatch, 4)
    world, heard = await World().up(), list[str | None]()
    outlet = await begin(world, ROTATION)
    world.fan_out.listeners[heard.append] = None
    world.fleet.frames.has_listeners = True
    others = [f"other{number}" for number in range(5)]
    for name in others:
        await world.apply(Appeared(name, 1), Described(described(robot=name)), Framed(name, world.frame(0.0).payload))
    heard.clear()
    woken = list[int]()
    world.fleet.frames.reader.open(lambda: woken.append(1))
    for name in [*others, "r"]:
        assert world.fleet.frames.put(name, world.frame(0.5).payload, 1)
    assert woken == [1]
    world.fan_out.waker()()
    turns = 0
    while len(outlet.messages) < 2:
        await asyncio.sleep(0)
        turns += 1
    assert (heard, turns > len(others)) == ([*others, "r"], True)
    assert b"0.5" in outlet.messages[-1].body


async def test_the_deadband_counts_from_the_sent_value() -> None:
    """A slow drift is news once it adds up; a subscriber without deadband gets each step."""
    world = await World().up()
    rough, fine = watch(world, ROTATION, deadband=0.25), watch(world, ROTATION)
    rough.watcher.schedule_send(), fine.watcher.schedule_send()
    await world.settle()
    await world.move(0.125, 0.1875, 0.25, 0.375, 0.0)
    assert len(fine.messages) == 6
    assert rough.versions == [fine.versions[index] for index in (0, 3, 5)]
    assert rough.previous[1:] == [fine.versions[index] for index in (2, 4)]
    await world.apply(Vanished("r", 1))  # presence is no value
    assert len(rough.messages) == 4


async def test_a_decimal_step_of_the_deadband_counts() -> None:
    """0.3 - 0.2 is less than 0.1 by rounding."""
    world = await World().up()
    outlet = await begin(world, ROTATION, deadband=0.1)
    await world.move(0.2, 0.3)
    assert outlet.frames == [1, 2, 3]


async def test_a_frame_of_an_offline_robot_tells_when_it_was_last_seen() -> None:
    """A frame may come after the token has gone. Of a robot that is online the time of its last frame is no news."""
    world = await World().up()
    outlet = await begin(world, ROTATION)

    async def hear(at_s: int) -> None:
        for change in world.fleet.apply(world.frame(0.0), at_s * 10**9):
            world.fan_out.mark_moved(change.robot)
        await world.settle()

    await hear(5)
    assert len(outlet.messages) == 1
    await world.apply(Vanished("r", 1))
    assert b"1970-01-01T00:00:05" in outlet.messages[-1].body
    await hear(7)
    assert len(outlet.messages) == 3
    assert b"1970-01-01T00:00:07" in outlet.messages[-1].body


async def test_interval_has_a_trailing_edge() -> None:
    """At once after a pause; then nothing before the interval has passed, and then the last value."""
    world = await World().up()
    outlet = await begin(world, ROTATION, interval_s=2.0)
    await world.move(0.1, 0.2)
    await world.advance(1.9)
    assert len(outlet.messages) == 1
    await world.advance(0.2)
    assert len(outlet.messages) == 2
    assert b"0.2" in outlet.messages[-1].body
    assert outlet.previous[-1] != outlet.versions[0], "one was left out"
    await world.advance(10)
    assert len(outlet.messages) == 2
    await world.move(0.3, 0.4)
    assert len(outlet.messages) == 3
    outlet.watcher.close()
    await world.advance(10)
    assert len(outlet.messages) == 3
    assert world.fan_out.empty


async def test_resuming() -> None:
    """With the present version: nothing before a change.

    With any other, whatever its order: the present state at once.
    """
    world = await World().up()
    before = await begin(world, ROTATION)
    (version,) = before.versions
    before.watcher.close()
    same, later = watch(world, ROTATION, {ROTATION: version}), watch(world, ROTATION, {ROTATION: "1-1000"})
    old, foreign = watch(world, ROTATION, {ROTATION: "0-9"}), watch(world, ROTATION, {ROTATION: "cancelled"})
    for each in (same, later, old, foreign):
        each.watcher.schedule_send()
    await world.settle()
    assert [len(each.messages) for each in (same, later, old, foreign)] == [0, 1, 1, 1]
    await world.move(0.1)
    assert [len(each.messages) for each in (same, later, old, foreign)] == [1, 2, 2, 2]
    assert same.previous == [version]


async def test_depths_of_a_joint() -> None:
    """This: presence. Properties: values in one message. Subtree: each property on its own."""
    world = await World().up()
    this, properties = (watch(world, JOINT, depth=depth) for depth in (Depth.THIS, Depth.PROPERTIES))
    subtree = watch(world, JOINT, depth=Depth.SUBTREE)
    for each in (this, properties, subtree):
        each.watcher.schedule_send()
    await world.settle()
    assert (this.take(), properties.take()) == ([JOINT], [JOINT])
    first = subtree.take()
    assert len(first) == len(set(first)) > 3
    assert {JOINT, ROTATION} <= set(first)
    await world.move(0.1)
    assert (this.take(), properties.take(), subtree.take()) == ([], [JOINT], [ROTATION])
    await world.apply(Vanished("r", 1))
    assert (this.take(), properties.take()) == ([JOINT], [JOINT])
    assert set(subtree.take()) == set(first)


async def test_a_subtree_follows_its_members() -> None:
    """Resources of a new description, of new robots and of new invocations are covered, up to their last state."""
    world = await World().up()
    outlet = await begin(world, "/", depth=Depth.SUBTREE)
    assert "/" in outlet.take()
    await world.apply(Appeared("s", 1), DescriptionRejected("s", 1, "it is silent"))
    assert set(outlet.take()) == {"/", "/s/"}
    joints = {"urdf": OTHER_URDF, "joints": ("wrist",)}
    await world.apply(Described(described(**joints)))
    paths = outlet.take()
    assert "/r/wrist/rotation" in paths
    assert not [path for path in paths if "elbow" in path]
    invocation = Invocation("i1", "r", "/r/wrist/actions/rotate", {"wrist": 1.0}, 0, 10**18)
    path = f"{invocation.action}/invocations/i1"
    world.invocations.add(invocation)
    world.fan_out.add_resource(path)
    for state in (InvocationState.ACCEPTED, InvocationState.RUNNING, InvocationState.SUCCEEDED):
        invocation.state = state
        world.fan_out.mark_changed(path)
        await world.settle()
        (message,) = outlet.messages
        assert state.value in message.body.decode()
        assert outlet.take() == [path]
    assert path not in outlet.watcher.topics  # it has ended, and its end was sent
    await world.apply(Vanished("s", 1))
    assert path not in outlet.take()


async def test_the_end_of_an_invocation_holds_back_nothing_of_its_round() -> None:
    world = await World().up()
    invocation = Invocation("i1", "r", "/r/elbow/actions/rotate", {"elbow": 1.0}, 0, 10**18)
    path = f"{invocation.action}/invocations/i1"
    world.invocations.add(invocation)
    outlet = await begin(world, ROBOT, depth=Depth.SUBTREE)
    outlet.take()
    outlet.room = False
    invocation.state = InvocationState.SUCCEEDED
    world.fan_out.mark_changed(path)
    await world.settle()
    await world.move(0.5)
    outlet.room = True
    outlet.watcher.schedule_send()
    await world.settle()
    paths = outlet.take()
    assert paths[0] == path
    assert ROTATION in paths


_INVOCATION = "/r/elbow/actions/rotate/invocations/i1"


@pytest.mark.parametrize(
    ("patient", "expired", "ending"),
    [
        (False, False, Ending.FINAL),
        (True, False, None),  # a callback stays until it is deleted
        (False, True, None),  # a late report may still change it
    ],
)
async def test_a_stream_of_an_invocation_ends_with_its_last_state(
    patient: bool, expired: bool, ending: Ending | None
) -> None:
    world = await World().up()
    invocation = Invocation("i1", "r", "/r/elbow/actions/rotate", {"elbow": 1.0}, 0, 10**18)
    world.invocations.add(invocation)
    outlets = [watch(world, _INVOCATION, patient=patient) for _ in range(2)]
    for each in outlets:
        each.watcher.schedule_send()
    await world.settle()
    outlets[0].room = False  # it gets the last state as soon as it has room
    invocation.state, invocation.expired = InvocationState.FAILED, expired
    world.fan_out.mark_changed(_INVOCATION)
    await world.settle()
    assert (outlets[0].ending, len(outlets[0].messages)) == (None, 1)
    outlets[0].room = True
    outlets[0].watcher.schedule_send()
    await world.settle()
    assert [(each.ending, len(each.messages)) for each in outlets] == [(ending, 2)] * 2
    assert b"linked-fleet#failed" in outlets[0].messages[-1].body
    if ending is not None:
        assert world.fan_out.empty


async def test_a_stream_of_an_ended_invocation_has_its_state_once() -> None:
    """A client that resumes with the last version gets nothing but the end."""
    world = await World().up()
    invocation = Invocation("i1", "r", "/r/elbow/actions/rotate", {"elbow": 1.0}, 0, 10**18)
    invocation.state = InvocationState.SUCCEEDED
    world.invocations.add(invocation)
    late = await begin(world, _INVOCATION)
    again = watch(world, _INVOCATION, {_INVOCATION: late.versions[0]})
    assert [(len(each.messages), each.ending) for each in (late, again)] == [(1, Ending.FINAL), (0, Ending.FINAL)]
    assert world.fan_out.empty


async def test_a_removed_resource_ends_watchers_except_patient_ones() -> None:
    """GONE without a resource; a patient watcher, such as a callback, continues when it is back."""
    world = await World().up()
    stream, callback = watch(world, ROTATION), watch(world, ROTATION, patient=True)
    stream.watcher.schedule_send(), callback.watcher.schedule_send()
    await world.settle()
    await world.apply(Described(described(urdf=OTHER_URDF, joints=("wrist",))))
    assert (stream.ending, callback.ending) == (Ending.GONE, None)
    assert watch(world, ROTATION).ending is Ending.GONE
    early = watch(world, ROTATION, patient=True)
    early.watcher.schedule_send()
    await world.apply(Described(described()), world.frame(0.5))
    assert b"0.5" in callback.messages[-1].body
    assert b"0.5" in early.messages[-1].body
    callback.watcher.close(), early.watcher.close()
    assert world.fan_out.empty


@pytest.mark.parametrize(
    "without", [DescriptionRejected("r", 1, "?"), Described(described(urdf=OTHER_URDF, joints=("wrist",)))]
)
async def test_a_description_may_change_while_a_subtree_is_scanned(
    without: Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scan does not look for the parts of before. Afterwards all parts of now are followed."""
    for turns in range(40):
        limit_turn(monkeypatch, 4)
        world = await World().up()
        outlet = watch(world, "/", depth=Depth.SUBTREE)
        outlet.watcher.schedule_send()
        for turn in range(turns + 3):
            if turn == turns:
                world.tell(without)
            await asyncio.sleep(0)
        await world.apply(Described(described()))
        paths = outlet.take()
        assert ROTATION in paths
        await world.move(0.5)
        assert set(outlet.take()) == {ROTATION, "/r/tip/pose"}


@pytest.mark.parametrize(("path", "depth"), [(ROTATION, Depth.PROPERTIES), (ROBOT, Depth.SUBTREE)])
async def test_a_resource_is_gone_when_the_message_about_it_is_due(path: str, depth: Depth) -> None:
    """A new description may come between the change of a resource and the turn of its watcher."""
    world = await World().up()
    outlet = watch(world, path, depth=depth, patient=True)
    outlet.watcher.schedule_send()
    await world.settle()
    outlet.room = False
    await world.move(0.5)
    outlet.take()
    world.tell(Described(described(urdf=OTHER_URDF, joints=("wrist",))))
    outlet.room = True
    while outlet.watcher.step():  # its turn comes before the resources are read
        pass
    assert not [each for each in outlet.take() if "elbow" in each]
    await world.apply(Described(described()), world.frame(0.7))
    outlet.watcher.schedule_send()
    await world.settle()
    assert ROTATION in outlet.take()


async def test_a_subtree_ends_with_its_root() -> None:
    world = await World().up()
    outlet = await begin(world, JOINT, depth=Depth.SUBTREE)
    await world.apply(Described(described(urdf=OTHER_URDF, joints=("wrist",))))
    assert outlet.ending is Ending.GONE
    assert world.fan_out.empty


async def test_a_robot_that_says_nothing_usable_for_a_while_ends_nobody() -> None:
    """Joints of a robot with an unusable description do not exist; their watchers get a message when they return."""
    world = await World().up()
    outlets = [watch(world, ROTATION), watch(world, JOINT, depth=Depth.SUBTREE)]
    for outlet in outlets:
        outlet.watcher.schedule_send()
    await world.settle()
    await world.apply(DescriptionRejected("r", 1, "it does not answer"))
    assert [outlet.ending for outlet in outlets] == [None, None]
    await world.apply(Described(described()), world.frame(0.5))
    for outlet in outlets:
        assert any(b"0.5" in message.body for message in outlet.messages)


async def test_a_message_shows_the_state_of_its_version() -> None:
    """A frame that arrives before a message is rendered is read first: no body is newer than its version."""
    world = await World().up()
    outlet = await begin(world, ROTATION)
    outlet.room = False
    await world.move(1.5)
    for change in world.fleet.apply(world.frame(2.0), 1):
        world.fan_out.mark_moved(change.robot)
    outlet.room = True
    outlet.watcher.step()  # its turn comes before the frame is read
    await world.move(1.5)
    assert [b'"1.5"' in message.body for message in outlet.messages[-2:]] == [False, True]


async def test_the_first_round_has_all_of_a_subtree_however_long_it_takes_to_find(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With an interval, a resource missing in the first round would come that much later."""
    turns = itertools.count()
    monkeypatch.setattr(fan_out.time, "perf_counter", lambda: next(turns) * fan_out.TURN_S / 4)  # a few steps per turn
    world = await World().up()
    outlet = await begin(world, ROBOT, depth=Depth.SUBTREE, interval_s=8.0)
    first = outlet.take()
    await world.advance(8.0)
    assert outlet.take() == [] and len(first) == len(set(first)) > 5


async def test_the_interval_lies_between_rounds_of_a_subtree() -> None:
    """News during a round waits for the next one."""
    world = await World().up()
    outlet = await begin(world, ROBOT, depth=Depth.SUBTREE, interval_s=8.0)
    outlet.take()
    await world.move(0.1)
    assert outlet.take() == []
    outlet.room = False
    await world.advance(8.0)
    outlet.room = True
    outlet.watcher.step()  # the first of the round: more than one resource has news of the move
    (first,) = outlet.take()
    outlet.room = False
    await world.move(0.2)
    outlet.room = True
    outlet.watcher.schedule_send()
    await world.settle()
    rest = outlet.take()
    assert len({first, *rest}) == 1 + len(rest) > 1
    await world.advance(8.0)
    assert first in outlet.take()


@pytest.mark.parametrize("seed", range(5))
async def test_readers_with_room_have_the_latest_message_beside_slow_ones(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Readers join, stall, catch up and leave in any order, and sending takes many turns.

    Nobody gets a version twice in a row or out of order, and in the end everybody has the last one.
    """
    dice = random.Random(seed)
    limit_turn(monkeypatch, 5)
    world = await World().up()
    here: list[Outlet] = []
    gone: list[tuple[Outlet, int]] = []
    for step in range(150):
        match dice.randrange(6):
            case 0:
                here.extend(watch(world, ROTATION) for _ in range(dice.choice((1, 40))))
                for outlet in here:
                    outlet.watcher.schedule_send()
            case 1 if here:
                outlet = here.pop(dice.randrange(len(here)))
                outlet.watcher.end(Ending.CANCELLED)
                gone.append((outlet, len(outlet.messages)))
            case 2 if here:
                outlet = dice.choice(here)
                outlet.room = not outlet.room
                if outlet.room:
                    outlet.watcher.schedule_send()
            case _:
                for change in world.fleet.apply(world.frame(step / 10), 1):
                    world.fan_out.mark_moved(change.robot)
        for _ in range(dice.randrange(3)):
            await asyncio.sleep(0)
    for outlet in here:
        outlet.room = True
        outlet.watcher.schedule_send()
    await world.move(1000.0)
    for outlet in here:
        assert b'"1000.0"' in outlet.messages[-1].body
        assert outlet.frames == sorted(set(outlet.frames))
    assert all(len(outlet.messages) == count for outlet, count in gone)


async def test_news_in_the_middle_of_a_message_to_many_comes_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Recipients of a message still get it, and then all get the latest; nobody gets the news in between."""
    limit_turn(monkeypatch, 4)
    world = await World().up()
    outlets = await begin_many(world, ROTATION, 300)
    for angle in (0.1, 0.2, 0.3):
        for change in world.fleet.apply(world.frame(angle), 1):
            world.fan_out.mark_moved(change.robot)
        await asyncio.sleep(0)
        await asyncio.sleep(0)
    await world.settle()
    assert {outlet.frames[-1] for outlet in outlets} == {4}
    if world.outlet is InStep:
        assert {tuple(outlet.frames) for outlet in outlets} == {(2, 4)}


async def test_last_message_is_noted_for_each(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each subscription reports its time, although members of a broadcast are served together."""
    world = await World().up()
    times = itertools.count(1)
    monkeypatch.setattr(fan_out.time, "time_ns", lambda: next(times))
    slow, fast = watch(world, ROTATION), watch(world, ROTATION)
    assert fast.watcher.last_sent_ns is None
    slow.watcher.schedule_send(), fast.watcher.schedule_send()
    await world.settle()
    before = slow.watcher.last_sent_ns
    slow.room = False
    await world.move(0.1)
    assert slow.watcher.last_sent_ns == before < fast.watcher.last_sent_ns


async def test_an_error_about_one_resource_keeps_no_message_from_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even those whose messages are ready in the same turn; and the resource itself is tried at its next change."""
    world = await World().up()
    broken = dict.fromkeys(("a", "z"))
    for name in broken:
        await world.apply(Appeared(name, 1), Described(described(robot=name)), Framed(name, world.frame(0.0).payload))
    paths = [ROTATION, *(f"/{name}/elbow/rotation" for name in broken)]
    outlets = [await begin(world, path) for path in (paths[1], ROTATION, paths[2])]
    for outlet in outlets:
        outlet.take()
    whole = Topic.message

    def message(topic: Topic[Any], media_type: str, base: str) -> Message:
        if topic.path != ROTATION:
            raise RuntimeError("a defect")
        return whole(topic, media_type, base)

    with monkeypatch.context() as patch:
        patch.setattr(Topic, "message", message)
        world.tell(*(Framed(name, world.frame(0.5).payload) for name in ("a", "r", "z")))
        await world.settle()
    assert [outlet.take() for outlet in outlets] == [[], [ROTATION], []]
    assert [str(each["exception"]) for each in world.failures] == ["a defect"] * 2
    world.failures.clear()
    world.tell(*(Framed(name, world.frame(0.7).payload) for name in ("a", "r", "z")))
    await world.settle()
    assert [len(outlet.take()) for outlet in outlets] == [1, 1, 1]


async def test_unwatched_resources_cost_nothing() -> None:
    """After the last watcher has left nothing is kept, and frames cause no turn."""
    world = await World().up()
    outlets = [watch(world, path) for path in (ROTATION, JOINT, ROBOT, "/")]
    outlets.append(watch(world, ROBOT, depth=Depth.SUBTREE))
    for outlet in outlets:
        outlet.watcher.schedule_send()
    await world.settle()
    for outlet in outlets:
        outlet.watcher.close()
    assert world.fan_out.empty
    for change in world.fleet.apply(world.frame(0.7), 1):
        world.fan_out.mark_moved(change.robot)
    assert world.fan_out.idle


# -- all of it in any order -------------------------------------------------------------------------------------------


def _watch_something(world: World, dice: random.Random) -> Outlet:
    path = dice.choice((ROTATION, JOINT, ROBOT, "/"))
    depths = [Depth.PROPERTIES] if path == ROTATION else list(Depth)
    more = {"interval_s": dice.choice((0.0, 0.0, 2.0)), "deadband": dice.choice((0.0, 0.0, 0.3))}
    outlet = watch(world, path, patient=dice.random() < 0.5, depth=dice.choice(depths), **more)
    outlet.watcher.schedule_send()
    return outlet


def _positions(outlet: Outlet) -> list[tuple[str, str, int]]:
    """Return path, media type and frame of each message about the robot."""
    return [
        (each.path, each.media_type, int(each.version.partition("-")[2].partition(".")[0]))
        for each in outlet.messages
        if each.path.startswith(ROBOT)
    ]


@pytest.mark.parametrize("seed", range(30))
async def test_whatever_comes_between_the_last_state_comes_last(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Watchers, readers, options, descriptions and frames in any order, in turns of a few steps."""
    dice = random.Random(seed)
    limit_turn(monkeypatch, dice.choice((4, 5, 8, 40)))
    world, here, other = await World().up(), list[Outlet](), Described(described(urdf=OTHER_URDF, joints=("wrist",)))
    for step in range(120):
        match dice.randrange(9):
            case 0:
                here += [_watch_something(world, dice) for _ in range(dice.choice((1, 1, 40)))]
            case 1 if here:
                here.pop(dice.randrange(len(here))).watcher.end(Ending.CANCELLED)
            case 2 if here:
                for outlet in dice.sample(here, dice.randrange(len(here)) + 1):
                    outlet.room = not outlet.room
                    outlet.watcher.schedule_send()
            case 3 if here:
                outlet = dice.choice(here)
                changed = dice.choice(({"interval_s": 2.0}, {"deadband": 0.2}, {"media_type": "text/turtle"}, {}))
                if outlet.ending is None:
                    change_options(world, outlet, **{"interval_s": 0.0, "deadband": 0.0} | changed)
            case 4:
                world.tell(dice.choice((other, DescriptionRejected("r", 1, "?"), Vanished("r", 1))))
                for _ in range(dice.randrange(3)):
                    await asyncio.sleep(0)
                world.tell(Appeared("r", 1), Described(described()), world.frame(step / 10))
            case 5:
                world.fan_out.advance(2 * dice.random())
            case _:
                world.tell(world.frame(step / 10))
        for _ in range(dice.randrange(3)):
            await asyncio.sleep(0)
    world.tell(world.frame(1000.0))
    for outlet in here:
        outlet.room = True
        outlet.watcher.schedule_send()
    await world.settle()
    await world.advance(3.0)
    await world.advance(3.0)
    for outlet in here:
        wanted = outlet.watcher.subscription
        latest = {message.path: message.body for message in outlet.messages}
        if outlet.ending is not None:
            assert outlet.ending is Ending.GONE
        elif wanted.depth is Depth.SUBTREE:
            assert b"1000.0" in latest[ROTATION]
        elif wanted.resource in (ROTATION, JOINT) and wanted.depth is Depth.PROPERTIES:
            assert b"1000.0" in latest[wanted.resource]
        else:
            assert wanted.resource in latest
        positions = _positions(outlet)
        for key in {each[:2] for each in positions}:
            frames = [each[2] for each in positions if each[:2] == key]
            assert frames == sorted(frames)
        outlet.watcher.close()
    assert world.fan_out.empty


async def test_changed_values_are_read_without_resolving_their_resource() -> None:
    """A robot may publish many values a second in messages that are no frames."""
    world, resolved = await World().up(), list[str]()
    outlet = await begin(world, ROTATION)
    tree = world.fan_out.tree

    def counted(base: str, view: View) -> fan_out.Tree:
        resolved.append(base)
        return tree(base, view)

    world.fan_out.tree = counted
    world.fleet.robots["r"].settings = {"title": "Another"}
    world.fan_out.mark_values_changed("r", ROTATION, "/r/elbow/velocity")
    await world.settle()
    assert (len(outlet.messages), resolved) == (2, [])


async def test_changed_values_take_no_other_change_away() -> None:
    """A joint that is gone is found gone, although its values were marked after it."""
    world = await World().up()
    outlet = await begin(world, ROTATION)
    world.fleet.apply(Described(described(urdf=OTHER_URDF, joints=("wrist",))), 0)
    world.fan_out.mark_robot_changed("r")
    world.fan_out.mark_values_changed("r", ROTATION)
    await world.settle()
    assert outlet.ending is Ending.GONE
