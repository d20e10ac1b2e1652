"""The policy of the fan-out when the options of a watcher change: what is due, what is repeated, what is lost."""

import asyncio

import pytest

from fan_out_world import JOINT, ROTATION, World, begin, begin_many, change_options, limit_turn, watch
from linked_fleet_gateway.resources.subscription import Depth

pytestmark = pytest.mark.usefixtures("outlet_kinds")


async def test_another_interval_counts_from_the_message_before() -> None:
    """A longer one delays a pending message, a shorter one releases it, and none leaves no timer behind."""
    world = await World().up()
    outlet = await begin(world, ROTATION, interval_s=2.0)
    await world.move(0.1)
    change_options(world, outlet, interval_s=5.0)
    await world.advance(4.9)
    assert len(outlet.messages) == 1
    await world.move(0.2)
    change_options(world, outlet, interval_s=4.0)
    await world.settle()
    assert outlet.frames[1:] == [3]
    await world.move(0.3)
    change_options(world, outlet, interval_s=0.0)
    await world.settle()
    await world.move(0.4, 0.5)
    assert outlet.frames[1:] == [3, 4, 5, 6]
    await world.advance(10)
    assert len(outlet.messages) == 5


async def test_a_new_interval_counts_from_the_change_of_options() -> None:
    world = await World().up()
    outlet, other = watch(world, ROTATION), watch(world, ROTATION)
    outlet.watcher.schedule_send(), other.watcher.schedule_send()
    await world.settle()
    await world.move(0.1)
    change_options(world, outlet, interval_s=3.0)
    await world.move(0.2, 0.3)
    assert (len(outlet.messages), len(other.messages)) == (2, 4)
    await world.advance(3.0)
    assert outlet.frames[-1] == other.frames[-1] == 4
    assert len(outlet.messages) == 3


async def test_a_changed_deadband_is_compared_with_the_sent_value() -> None:
    """A smaller deadband sends changes that were suppressed before; a larger one suppresses further changes."""
    world = await World().up()
    outlet = await begin(world, ROTATION, deadband=0.5)
    await world.move(0.3)
    assert len(outlet.messages) == 1
    change_options(world, outlet, deadband=0.2)
    await world.settle()
    assert outlet.frames[1:] == [2]
    outlet.room = False
    await world.move(0.6)
    change_options(world, outlet, deadband=0.5)
    outlet.room = True
    outlet.watcher.schedule_send()
    await world.settle()
    assert outlet.frames[1:] == [2]
    await world.move(0.9)
    assert outlet.frames[1:] == [2, 4]


@pytest.mark.parametrize("options", [{"depth": Depth.SUBTREE}, {"media_type": "text/turtle"}])
async def test_another_depth_or_media_type_begins_with_the_present_state(options: dict[str, object]) -> None:
    """Everything covered is sent, whatever was sent before, and nothing of the former watch is kept."""
    world = await World().up()
    outlet = await begin(world, JOINT)
    await world.move(0.1)
    outlet.take()
    change_options(world, outlet, **options)
    await world.settle()
    paths = outlet.take()
    subtree = "depth" in options
    assert paths[0] == JOINT
    assert (ROTATION in paths) is subtree
    assert len(paths) == len(set(paths))
    change_options(world, outlet, depth=Depth.PROPERTIES, media_type="application/n-triples")
    await world.settle()
    assert outlet.take() == [JOINT]
    await world.move(0.2)
    assert outlet.take() == [JOINT]
    outlet.watcher.close()
    assert world.fan_out.empty


@pytest.mark.parametrize("options", [{"interval_s": 60.0}, {"secret": "x"}, {"media_type": "text/turtle"}])
async def test_a_change_in_the_middle_of_a_message_to_many_loses_and_repeats_nothing(
    monkeypatch: pytest.MonkeyPatch, options: dict[str, object]
) -> None:
    """The watcher gets each version once and finally the latest, before its turn in a message and after it."""
    limit_turn(monkeypatch, 4)
    world = await World().up()
    outlets = await begin_many(world, ROTATION, 120)
    for angle in (0.1, 0.2):
        for change in world.fleet.apply(world.frame(angle), 1):
            world.fan_out.mark_moved(change.robot)
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        for outlet in outlets[:: 7 if angle == 0.1 else 5]:
            change_options(world, outlet, **options)
    await world.settle()
    await world.advance(61.0)
    for outlet in outlets:
        said = [(message.media_type, message.version) for message in outlet.messages]
        assert len(set(said)) == len(said)
        assert outlet.frames == sorted(outlet.frames)
        assert outlet.frames[-1] == 3
