"""How the simulated robots of the catalogue actually move when an agent commands them, on the test's own clock."""

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy
import pytest

from linked_fleet_agent.agent import Agent
from linked_fleet_agent.robot import JointFacts, Robot
from linked_fleet_agent.robots.catalogue import MODELS, data_folder, load, poses_of
from linked_fleet_agent.urdf.cruise import cruise_of
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.messages import Accepted, Command, Follow, Move, Progress, Reply, State, Stop

PERIOD_NS = 10_000_000
POSES = [(name, pose) for name, model in MODELS.items() for pose in model.poses]


class Bench:
    """A simulated robot with its agent, which records frames and progress; also stands in for the link."""

    gateway_present, arrivals = True, 1

    def __init__(self, source: str) -> None:
        self.frames: list[State] = []
        self.progress: list[Progress] = []
        self.now_ns = 1_000_000_000
        self.robot: Robot = load(source, source)
        self.joints = {joint.name: joint for joint in self.robot.describe().joints}
        self.poses = poses_of(MODELS[source], tuple(self.joints.values()))
        self.agent = Agent(source, self.robot, monotonic_ns=lambda: self.now_ns)
        self.run(0.2)

    def watch_gateways(self, period_s: float) -> None:
        """Do nothing: a gateway is always present."""

    def publish_state(self, payload: bytes) -> None:
        self.frames.append(codec.decode_state(payload))

    def publish_condition(self, payload: bytes) -> None:
        """Ignore it."""

    publish_values = publish_event = publish_condition

    def publish_progress(self, payload: bytes, final: bool) -> None:
        self.progress.append(codec.decode(payload, Progress))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.now_ns += PERIOD_NS
            self.agent.tick(self)

    def command(self, command_id: str, motion: Move | Follow, **more: Any) -> Reply:
        last = self.frames[-1]
        asked = Command(
            version=1,
            id=command_id,
            incarnation=last.incarnation,
            seen_ns=last.monotonic_ns,
            time_to_live_ns=1_000_000_000,
            motion=motion,
            **more,
        )
        return codec.decode_reply(self.agent.handle(codec.encode(asked)))

    def finish(self, command_id: str, motion: Move | Follow) -> Progress:
        """Let it run for the announced duration, and half a second to settle."""
        reply = self.command(command_id, motion)
        assert isinstance(reply, Accepted), reply
        self.run(reply.duration_s + 0.5)
        return self.end(command_id)

    def end(self, command_id: str) -> Progress:
        return [progress for progress in self.progress if progress.id == command_id][-1]

    def rows(self, of: str) -> Mapping[str, numpy.ndarray]:
        columns = numpy.array([getattr(frame, of) for frame in self.frames]).T
        return dict(zip(self.joints, columns, strict=True))


def _held_its_limits(bench: Bench) -> None:
    """Check that no joint exceeded its URDF limits; mimicking joints and free wheels follow others."""
    speeds, efforts, positions = bench.rows("velocities"), bench.rows("efforts"), bench.rows("positions")
    for name, joint in bench.joints.items():
        limits = joint.limits
        if limits.velocity is not None and joint.mimics is None:
            assert abs(speeds[name]).max() <= limits.velocity, name
        if limits.effort is not None:
            assert abs(efforts[name]).max() <= limits.effort * (1 + 1e-9), name
        if limits.lower is not None and limits.upper is not None and joint.mimics is None:
            assert positions[name].min() >= limits.lower - 2e-3, name
            assert positions[name].max() <= limits.upper + 2e-3, name


def _stands_upright(bench: Bench) -> None:
    base = bench.frames[-1].base
    if base is not None and MODELS[bench.agent.name].parts.base is None:
        assert base.position_m[2] > 0.18
        assert base.orientation_xyzw[3] > 0.99


@pytest.mark.parametrize(("source", "pose"), POSES)
def test_a_named_pose_is_reached_exactly_and_home_again(source: str, pose: str) -> None:
    """At full speed, within limits, without falling; "succeeded" means within a millimetre at the tip."""
    bench = Bench(source)
    for title in (pose, "home"):
        end = bench.finish(title, Move(bench.poses[title]))
        assert (end.state, end.reason) == ("succeeded", "")
        assert end.positions == pytest.approx(bench.poses[title], abs=2e-4)
        _stands_upright(bench)
    bench.run(1.0)
    _held_its_limits(bench)
    _stands_upright(bench)
    last = dict(zip(bench.joints, bench.frames[-1].positions, strict=True))
    assert {name: last[name] for name in bench.poses["home"]} == pytest.approx(bench.poses["home"], abs=2e-4)


@pytest.mark.parametrize("source", sorted(name for name, model in MODELS.items() if model.home))
def test_home_is_where_the_robot_starts(source: str) -> None:
    bench = Bench(source)
    start = dict(zip(bench.joints, bench.frames[0].positions, strict=True))
    assert {name: start[name] for name in bench.poses["home"]} == pytest.approx(bench.poses["home"], abs=1e-3)


def _out_and_back(joints: Mapping[str, JointFacts], home: Mapping[str, float], pose: Mapping[str, float]) -> Follow:
    """Return a path as fast as permitted: guessed times, stretched for the speed of each joint."""
    names = tuple(name for name in pose if pose[name] != home[name])
    middle = tuple((home[name] + pose[name]) / 2 for name in names)
    rows = (middle, tuple(pose[name] for name in names), middle, tuple(home[name] for name in names))
    slowest_s = max(abs(pose[name] - home[name]) / 2 / cruise_of(joints[name]) for name in names)
    return Follow(names, tuple(slowest_s * 1.6 * number for number in range(1, 5)), rows)


@pytest.mark.parametrize(("source", "pose"), [item for item in POSES if item[1] != "open"])
def test_a_path_is_followed_as_fast_as_is_allowed_and_within_limits(source: str, pose: str) -> None:
    bench = Bench(source)
    follow = _out_and_back(bench.joints, bench.poses["home"], bench.poses[pose])
    faster = tuple(time_s * 0.5 for time_s in follow.times_s)
    assert not isinstance(bench.command("fast", Follow(follow.joints, faster, follow.positions)), Accepted)
    end = bench.finish("follow", follow)
    assert (end.state, end.reason) == ("succeeded", "")
    _held_its_limits(bench)
    _stands_upright(bench)


@pytest.mark.parametrize(("source", "pose"), [item for item in POSES if item[1] != "open"])
def test_a_stop_in_full_motion_is_smooth_and_holds(source: str, pose: str) -> None:
    """From cruise to rest within the limits; then nothing moves any more."""
    bench = Bench(source)
    assert isinstance(bench.command("m", Move(bench.poses[pose])), Accepted)
    bench.run(0.6)
    stop = codec.decode_reply(bench.agent.handle_stop(codec.encode(Stop(version=1, id="s"))))
    assert isinstance(stop, Accepted)
    bench.run(stop.duration_s + 0.5)
    assert (bench.end("m").state, bench.end("s").state) == ("cancelled", "succeeded")
    rested = bench.frames[-1].positions
    bench.run(1.0)
    assert bench.frames[-1].positions == pytest.approx(rested, abs=1e-4)
    _held_its_limits(bench)
    _stands_upright(bench)


def _leap(robot: Robot, begin_s: float) -> tuple[float, float]:
    """Make the setpoint of the last revolute joint jump, as no agent does; return its highest effort and speed."""
    joints = robot.describe().joints
    index = max(i for i, joint in enumerate(joints) if joint.mimics is None and not joint.linear)
    start = robot.read(begin_s).positions[index]
    robot.apply({joints[index].name: start + 1.0})
    readings = [robot.read(begin_s + step * 0.01) for step in range(1, 200)]
    assert abs(readings[-1].positions[index] - start) > 0.1
    return max(abs(r.efforts[index]) for r in readings), max(abs(r.velocities[index]) for r in readings)


@pytest.mark.parametrize("source", ["baxter", "panda", "tiago", "ur5"])
def test_not_even_a_leap_of_the_setpoint_exceeds_the_limits_of_effort_and_speed(source: str) -> None:
    robot = load(source, source)
    limits = [joint.limits for joint in robot.describe().joints if joint.mimics is None and not joint.linear][-1]
    effort, speed = _leap(robot, 1.0)
    assert limits.effort is not None
    assert limits.velocity is not None
    assert effort <= limits.effort
    assert speed <= limits.velocity


def test_a_motor_pushes_as_hard_as_its_effort_limit_and_no_harder(tmp_path: Path) -> None:
    """With a limit low enough to be reached, the force saturates exactly there."""
    weak = tmp_path / "weak.urdf"
    text = (data_folder() / MODELS["ur5"].file).read_text()
    assert text.count('effort="28.0"') >= 3
    weak.write_text(text.replace('effort="28.0"', 'effort="0.5"'))
    assert _leap(load("weak", str(weak)), 1.0)[0] == pytest.approx(0.5)


@pytest.mark.parametrize("source", sorted(name for name, model in MODELS.items() if model.home))
def test_redirected_and_stopped_again_and_again_limits_hold(source: str) -> None:
    """Redirected at full speed, with stops in between."""
    bench = Bench(source)
    titles = itertools.cycle([next(iter(MODELS[source].poses)), "home"])
    for number in range(12):
        assert isinstance(bench.command(f"m{number}", Move(bench.poses[next(titles)])), Accepted)
        bench.run(0.35)
        if number % 4 == 3:
            bench.agent.handle_stop(codec.encode(Stop(version=1, id=f"s{number}")))
            bench.run(0.2)
    bench.run(3.0)
    _held_its_limits(bench)
    _stands_upright(bench)
