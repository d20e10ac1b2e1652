"""Jogging of joints: how they move, what slows them down and stops them, and that they never pass their limits."""

import itertools
import random
from typing import Any

import pytest
from msgspec import UNSET

from component_agent import Hand
from jogged_arm import LIMITS, TICK_S, Jogged
from linked_fleet_agent.components import Component, Grasped, Gripper, Mode, SpeedScale, action, value
from linked_fleet_agent.components.kinds import Force, Holding, Width
from linked_fleet_agent.urdf.cruise import RAMP_S
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.components import DescriptionWithComponents, read_declarations
from linked_fleet_agent.wire.messages import Accepted, Refused

CRUISE = {"turn": 1.5, "elbow": 0.8, "lift": 0.16, "wrist 1": 1.5}


def declared(bench: Jogged) -> dict[str, Any]:
    said = codec.decode(bench.agent.description, DescriptionWithComponents)
    found, refused = read_declarations(said.components, ("a", "b", "c", "d", "e"), said.joints)
    assert not refused
    return {each.name: each for each in found}


def test_an_agent_offers_it_for_the_joints_that_take_setpoints() -> None:
    jogging = declared(Jogged())["jogging"]
    jog = jogging.actions["jogJoints"]
    assert jog.moves == ("turn", "elbow", "lift", "wrist 1")
    velocities = jog.input.properties["velocities"].properties
    assert {name: (each.minimum, each.maximum, each.unit) for name, each in velocities.items()} == {
        name: (-most, most, "M-PER-SEC" if name == "lift" else "RAD-PER-SEC") for name, most in CRUISE.items()
    }
    assert (jog.stream.age_s, jog.stream.silence_s, jog.stream.end_s) == (0.15, 0.2, 2.0)


def test_a_driver_may_have_a_component_of_this_name_itself() -> None:
    class Own(Component):
        """Something else."""

        name = "jogging"

    assert declared(Jogged(Own()))["jogging"].description == "Something else."


class Fingers(Gripper, blocking=False):
    name = "gripper"

    @value
    def width(self) -> Width:
        return 0.0

    @value
    def force(self) -> Force:
        return 0.0

    @value
    def holding(self) -> Holding:
        return False

    @action(moves=["lift"])
    async def grasp(self, width: Width = 0.0, force: Force = 1.0) -> Grasped:
        return Grasped(0.0, False)

    @action(moves=["lift"])
    async def open(self, width: Width = 0.0) -> None: ...


async def test_fingers_of_a_gripper_are_left_to_the_gripper() -> None:
    bench = Jogged(Fingers())
    assert declared(bench)["jogging"].actions["jogJoints"].moves == ("turn", "elbow", "wrist 1")
    bench.open()
    await bench.jog(0.3, turn=0.3)
    assert isinstance(bench.operate("g", "grasp", {}, component="gripper"), Accepted)
    await bench.tick(0.05)
    assert bench.states("s") == ["running"]
    assert bench.states("g") == ["running", "succeeded"]


async def test_a_request_moves_for_its_time_and_brakes() -> None:
    bench = Jogged()
    bench.request("j", duration=0.6, turn=1.0, lift=-0.05)
    await bench.tick(0.5)
    assert bench.speed("turn") == pytest.approx(1.0)
    assert bench.speed("lift") == pytest.approx(-0.05)
    await bench.tick(0.6)
    assert bench.states("j") == ["running", "succeeded"]
    assert [bench.speed(joint) for joint in CRUISE] == [0.0] * 4
    ramps_s = 1.0 / CRUISE["turn"] * RAMP_S
    assert bench.arm.positions["turn"] == pytest.approx(0.6 * 1.0 - ramps_s / 2 + ramps_s / 2, abs=0.02)
    assert bench.arm.positions["lift"] == pytest.approx(0.1 - 0.05 * bench.arm.positions["turn"], abs=1e-6)


async def test_a_newer_request_takes_over_the_speed() -> None:
    bench = Jogged()
    bench.request("one", turn=0.8)
    await bench.tick(0.3)
    bench.request("two", turn=0.8)
    await bench.tick(0.2)
    assert bench.states("one") == ["running", "preempted"]
    assert min(bench.velocities("turn", 20)) == pytest.approx(0.8)


async def test_samples_jog_and_silence_brakes_within_the_limits() -> None:
    bench = Jogged()
    bench.open()
    number = await bench.jog(0.6, turn=1.0, elbow=-0.2)
    assert bench.speed("turn") == pytest.approx(1.0)
    await bench.tick(0.17)
    assert bench.speed("turn") == pytest.approx(1.0)
    await bench.tick(0.06)
    assert bench.speed("turn") < 1.0
    await bench.tick(0.4)
    assert bench.speed("turn") == bench.speed("elbow") == 0.0
    stream = bench.end("s").stream
    assert stream is not UNSET
    assert stream.silent
    most = CRUISE["turn"] / RAMP_S
    slowing = itertools.pairwise(bench.velocities("turn", 60))
    assert max(before - after for before, after in slowing) <= most * TICK_S + 1e-9
    await bench.jog(0.3, first=number, turn=0.5)
    assert bench.speed("turn") == pytest.approx(0.5)


async def test_a_late_sample_moves_nothing() -> None:
    bench = Jogged()
    bench.open()
    for number in range(20):
        bench.sample(number, {"turn": 1.0}, age_ms=151)
        bench.sample(100 + number, {"turn": 2.0})
        await bench.tick()
    assert bench.arm.positions["turn"] == 0.0
    await bench.tick(0.12)
    stream = bench.end("s").stream
    assert stream is not UNSET
    assert (stream.late, stream.invalid, stream.applied) == (20, 20, 0)


async def test_all_joints_slow_down_together_before_one_reaches_its_limit() -> None:
    bench = Jogged()
    bench.open()
    await bench.jog(4.0, turn=0.4, elbow=0.5)
    position = bench.arm.positions
    assert position["elbow"] == pytest.approx(1.0, abs=1e-3)
    assert position["elbow"] <= 1.0
    assert all(each["turn"] == pytest.approx(0.8 * each["elbow"], abs=1e-3) for each in bench.arm.path)
    assert bench.shown("limitedBecause") == "elbow is near its limit"


@pytest.mark.parametrize("seed", range(20))
async def test_random_samples_never_lead_beyond_limits_speeds_and_accelerations(seed: int) -> None:
    draw = random.Random(seed)
    bench = Jogged()
    bench.open()
    number = 0
    for _ in range(30):
        wanted = {name: draw.choice((-most, 0.0, most, draw.uniform(-most, most))) for name, most in CRUISE.items()}
        number = await bench.jog(draw.uniform(0.03, 0.8), first=number, **wanted)
        await bench.tick(draw.choice((0.01, 0.01, 0.3)))
    for joint, most in CRUISE.items():
        lower, upper = LIMITS[joint]
        assert all(lower <= each[joint] <= upper for each in bench.arm.path)
        speeds = bench.velocities(joint, len(bench.arm.path) - 1)
        assert max(map(abs, speeds)) <= most + 1e-9
        changes = [abs(after - before) for before, after in itertools.pairwise(speeds)]
        assert max(changes) <= 1.02 * most / RAMP_S * TICK_S
    assert bench.states("s") == ["running"]


async def test_a_joint_outside_its_limits_moves_slowly_back_and_never_further_out() -> None:
    bench = Jogged(elbow=1.2)
    bench.open()
    number = await bench.jog(0.5, elbow=0.8)
    assert bench.arm.positions["elbow"] == pytest.approx(1.2)
    await bench.jog(0.5, first=number, elbow=-0.8)
    assert bench.speed("elbow") == pytest.approx(-0.2)
    assert bench.shown("limitedBecause") == "elbow is outside its limits"


@pytest.mark.parametrize("way", ["stop", "gateway", "protective stop"])
async def test_whatever_ends_motions_ends_jogging_and_brakes(way: str) -> None:
    mode = Mode()
    bench = Jogged(mode)
    bench.open()
    number = await bench.jog(0.5, turn=1.0)
    if way == "stop":
        assert isinstance(bench.stop("e"), Accepted)
    elif way == "gateway":
        bench.link.gateway_present = False
    else:
        mode.stop_protectively("the gate is open")
    path = len(bench.arm.path)
    await bench.jog(0.6, first=number, turn=1.0)
    assert bench.states("s")[-1] == ("cancelled" if way == "stop" else "failed")
    assert bench.speed("turn") == 0.0
    gone = bench.arm.positions["turn"] - bench.arm.path[path]["turn"]
    assert gone <= 1.0 / (2 * CRUISE["turn"] / RAMP_S) + 0.03
    if way == "stop":
        assert bench.states("e") == ["running", "succeeded"]
    assert isinstance(bench.operate("n", "jogJoints", {}, component="jogging"), Accepted if way == "stop" else Refused)


async def test_a_motion_of_joints_preempts_jogging_and_is_preempted_by_it() -> None:
    bench = Jogged()
    bench.open()
    number = await bench.jog(0.5, turn=1.0)
    assert isinstance(bench.move("m", elbow=0.5), Accepted)
    await bench.jog(0.5, first=number, turn=1.0)
    assert bench.states("s") == ["running", "preempted"]
    assert bench.speed("turn") == 0.0
    assert bench.speed("elbow") > 0.0
    bench.open("again")
    await bench.tick(0.5)
    assert bench.states("m") == ["running", "preempted"]
    await bench.jog(0.3, id="again", elbow=-0.1)
    assert bench.speed("elbow") == pytest.approx(-0.1)


async def test_of_two_streams_the_newer_one_jogs_and_the_robot_brakes_between_them() -> None:
    bench = Jogged()
    bench.open("one")
    number = await bench.jog(0.5, id="one", turn=1.0)
    bench.open("two")
    await bench.jog(0.6, id="one", first=number, turn=1.0)
    assert bench.states("one") == ["running", "preempted"]
    assert bench.speed("turn") == 0.0
    await bench.jog(0.5, id="two", turn=-1.0)
    assert bench.speed("turn") == pytest.approx(-1.0)


async def test_a_joint_that_something_holds_ends_it_and_nothing_pushes_on() -> None:
    bench = Jogged()
    bench.open()
    bench.arm.held.add("turn")
    await bench.jog(2.5, turn=1.0, elbow=0.2)
    assert bench.states("s") == ["running", "failed"]
    assert bench.end("s").reason == "turn is stuck at 0 rad"
    bench.arm.held.clear()
    stood = bench.arm.positions["turn"]
    await bench.tick(1.0)
    assert bench.arm.positions["turn"] == pytest.approx(stood, abs=1e-6)


async def test_a_joint_at_an_unknown_place_is_not_jogged_and_the_others_are() -> None:
    bench = Jogged()
    bench.arm.unknown.add("turn")
    await bench.tick()
    bench.open()
    await bench.jog(0.3, elbow=0.3)
    assert bench.speed("elbow") == pytest.approx(0.3)
    await bench.jog(0.4, first=100, turn=0.3)
    assert bench.states("s") == ["running", "failed"]
    assert bench.end("s").reason == "the position of turn is unknown"


class Half(Mode):
    name = "mode"

    @value
    def speed_scale(self) -> SpeedScale:
        return 0.5


async def test_the_speed_follows_the_mode_of_the_robot() -> None:
    bench = Jogged(Half())
    bench.open()
    await bench.jog(0.5, turn=1.0)
    assert bench.speed("turn") == pytest.approx(0.5)


async def test_nothing_moves_after_a_pause_of_the_agent() -> None:
    bench = Jogged()
    bench.open()
    await bench.jog(0.5, turn=1.0)
    bench.now_ns += 3_000_000_000
    before = bench.arm.positions["turn"]
    await bench.tick(0.5)
    assert bench.arm.positions["turn"] == pytest.approx(before, abs=1e-9)
    assert bench.states("s") == ["running", "failed"]


async def test_another_component_and_jogging_preempt_each_other() -> None:
    class Turner(Hand):
        """Something that turns the first joint."""

        name = "turner"

        @action(moves=["turn"])
        async def turn(self) -> None:
            await self._until_open()

        grasp = release = None  # type: ignore[assignment]

    bench = Jogged(Turner())
    bench.open()
    await bench.jog(0.3, turn=0.5)
    assert isinstance(bench.operate("t", "turn", component="turner"), Accepted)
    await bench.tick(0.3)
    assert bench.states("s") == ["running", "preempted"]
    assert bench.states("t") == ["running"]
