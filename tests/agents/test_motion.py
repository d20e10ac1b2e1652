"""The motion of setpoints, with joints that follow perfectly, one that is stuck, and one that is taken over."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.axis import SETTLE_S, STANDSTILL_S, Measurements
from linked_fleet_agent.motion import Motions, Outcome, Sway
from linked_fleet_agent.plan import OUTSIDE_SHARE, ImpossibleError, joints_of, plan
from linked_fleet_agent.robot import JointFacts, Limits
from linked_fleet_agent.sensors import JointSensor
from linked_fleet_agent.setpoints import rate_of
from linked_fleet_agent.urdf.cruise import RAMP_S, cruise_of
from linked_fleet_agent.wire.messages import Follow, Move
from sensor_faults import EVENTS, Event, shown_position

ARM = JointFacts("arm", limits=Limits(-3.0, 3.0, 1.0, 5.0))
JOINTS = {"arm": ARM, "wheel": JointFacts("wheel", continuous=True), "lift": JointFacts("lift", linear=True)}
DT = 0.01


class Robot:
    """Joints that reach their setpoints at once, unless they are ``stuck``.

    ``shown`` replaces what the sensor of a joint shows.
    """

    def __init__(self, sways: Sequence[Sway] = (), arm: float = 0.0, wheel: float = 0.0) -> None:
        self.motions = Motions(JOINTS, sways)
        self.positions = {"arm": arm, "wheel": wheel, "lift": 0.0}
        self.setpoints: dict[str, float] = {}
        self.sent: list[tuple[float, float]] = []
        """The setpoints of the arm, each with its time in s."""
        self.stuck: set[str] = set()
        self.shown: dict[str, float] = {}
        self.paths = {name: [position] for name, position in self.positions.items()}
        self.outcomes: list[Outcome] = []
        self._sensors = {name: JointSensor(joint, DT) for name, joint in JOINTS.items()}
        self._now_s = 0.0
        self.measured = self._measure()

    def move(
        self, command_id: str, speeds: dict[str, float] | None = None, scale: float = 1.0, **targets: float
    ) -> float:
        """Begin a motion; return its duration in s."""
        return self._start(command_id, Move(targets, speeds or {}), scale)

    def follow(
        self, command_id: str, times_s: Sequence[float], scale: float = 1.0, **columns: Sequence[float]
    ) -> float:
        rows = tuple(zip(*columns.values(), strict=True))
        return self._start(command_id, Follow(tuple(columns), tuple(times_s), rows), scale)

    def _start(self, command_id: str, motion: Move | Follow, scale: float) -> float:
        motion = self.motions.unwound(motion, self.measured.positions)
        made = plan(motion, scale, self.motions.starts(joints_of(motion)))
        self.outcomes += self.motions.start(command_id, made)
        return made.duration_s

    def stop(self, stop_id: str, *joints: str, command: str = "") -> float:
        duration_s, outcomes = self.motions.stop(stop_id, joints or tuple(JOINTS), command, "stopped")
        self.outcomes += outcomes
        return duration_s

    def step(self, steps: int, held: bool = False) -> None:
        for _ in range(steps):
            self._now_s += DT
            self.measured = self._measure()
            setpoints, outcomes = self.motions.step(DT, self.measured, held)
            self.outcomes += outcomes
            assert self.motions.setpoints.limit(setpoints, DT) == pytest.approx(setpoints, abs=1e-8)
            self.motions.adopt_setpoints(setpoints)
            self.setpoints |= setpoints
            self.sent += [(self._now_s, setpoints["arm"])] if "arm" in setpoints else []
            self.positions |= {name: at for name, at in setpoints.items() if name not in self.stuck}
            for name, path in self.paths.items():
                path.append(self.positions[name])

    def carry(self, joint: str, to: float, speed: float = 1.0, held: bool = False) -> None:
        """Let something else move a joint, at a speed in rad/s or m/s."""
        while self.positions[joint] != to:
            way = to - self.positions[joint]
            self.positions[joint] = (
                to if abs(way) <= speed * DT else self.positions[joint] + math.copysign(speed * DT, way)
            )
            self.step(1, held)

    def _measure(self) -> Measurements:
        shown = self.positions | self.shown
        positions = {name: sensor.update(shown[name], self._now_s) for name, sensor in self._sensors.items()}
        self.motions.setpoints.follow(positions.values(), self.motions.driven, DT)
        efforts = {name: 5.0 if name in self.stuck else 0.0 for name in JOINTS}
        standing_s = {name: sensor.standing_s for name, sensor in self._sensors.items()}
        faults = {name: sensor.fault for name, sensor in self._sensors.items() if sensor.fault}
        return Measurements(positions, efforts, standing_s, faults)

    def states(self, command_id: str) -> list[str]:
        return [outcome.state for outcome in self.outcomes if outcome.command_id == command_id]

    def end(self, command_id: str) -> Outcome:
        return [outcome for outcome in self.outcomes if outcome.command_id == command_id][-1]

    def fastest(self, joint: str) -> float:
        return max(abs(b - a) / DT for a, b in itertools.pairwise(self.paths[joint]))


goals = st.tuples(
    st.floats(-3, 3), st.floats(0.01, 1.0), st.integers(1, 400), st.sampled_from(["move", "follow", "stop"])
)


@given(st.floats(-3, 3), st.lists(goals, min_size=1, max_size=6))
def test_no_setpoint_is_ever_faster_than_the_cruise_or_beyond_a_limit(
    start: float, orders: list[tuple[float, float, int, str]]
) -> None:
    """However often it is redirected, put on a path or stopped; and the last goal is reached exactly."""
    robot = Robot(arm=start)
    for number, (goal, scale, steps, kind) in enumerate(orders):
        if kind == "stop":
            robot.stop(str(number))
        elif kind == "move":
            robot.move(str(number), scale=scale, arm=goal)
        else:
            try:
                robot.follow(str(number), [1.0, 4.0], arm=[(goal + robot.positions["arm"]) / 2.0, goal])
            except ImpossibleError:
                robot.stop(str(number))
        robot.step(steps)
    robot.move("last", arm=orders[-1][0])
    robot.step(2_000)
    assert robot.fastest("arm") <= cruise_of(ARM) * (1 + 1e-6)
    assert all(-3.0 <= position <= 3.0 for position in robot.paths["arm"])
    assert robot.paths["arm"][-1] == orders[-1][0]
    assert robot.states("last") == ["running", "succeeded"]


@given(
    st.floats(3.0, 4.0),
    st.sampled_from([-1.0, 1.0]),
    st.floats(-3, 3),
    st.integers(1, 300),
    st.sampled_from(["stop", "move", "path", "loss"]),
)
def test_a_joint_outside_its_limits_moves_back_from_where_it_stands(
    outside: float, side: float, goal: float, steps: int, then: str
) -> None:
    """At no more than its speed and acceleration, never further out, and also if it is stopped or redirected."""
    robot = Robot(arm=side * outside)
    robot.move("back", arm=goal)
    robot.step(steps)
    if then == "stop":
        robot.stop("stop")
    elif then == "loss":
        robot.outcomes += robot.motions.halt("gateway lost")
    elif then == "move":
        robot.move("there", scale=0.5, arm=side * 3.0)
    else:
        try:
            robot.follow("there", [8.0, 12.0], arm=[side * 2.0, goal])
        except ImpossibleError:
            robot.stop("stop")
    robot.step(1_500)
    path = [side * position for position in robot.paths["arm"]]
    assert robot.fastest("arm") <= cruise_of(ARM) * (1 + 1e-6)
    speeds = [(after - before) / DT for before, after in itertools.pairwise([path[0], *path])]
    changes = [abs(after - before) / DT for before, after in itertools.pairwise(speeds)]
    if then != "path":  # its cubics are limited in speed alone
        assert max(changes) <= cruise_of(ARM) / RAMP_S * (1 + 1e-6)
    assert all(after <= max(before, 3.0) + 1e-9 for before, after in itertools.pairwise(path))
    assert robot.motions.idle


@pytest.mark.parametrize("away", [0.005, 0.5])
def test_a_stop_of_a_standing_joint_succeeds_where_it_stands(away: float) -> None:
    """It sags from its last setpoint, or something else has moved it. While it falls, the stop does not succeed."""
    robot = Robot()
    robot.move("m", arm=1.0)
    robot.step(400)
    assert robot.states("m")[-1] == "succeeded"
    robot.stuck.add("arm")
    robot.carry("arm", 1.0 - away)
    robot.stop("s", "arm")
    robot.step(300)
    assert robot.states("s") == ["running", "succeeded"]
    robot.stop("t", "arm")
    for _ in range(300):
        robot.positions["arm"] -= 0.1 * DT
        robot.step(1)
    assert robot.states("t") == ["running", "failed"]
    assert robot.end("t").reason == "not come to rest: arm"


@pytest.mark.parametrize("speed", [0.05, 0.5, 1.0])
def test_a_stop_holds_what_something_else_moves(speed: float) -> None:
    """It sends setpoints near the joint until the joint stands, and does not succeed before."""
    robot = Robot()
    robot.stuck.add("arm")
    robot.carry("arm", 0.5, speed)
    robot.stop("s")
    assert robot.setpoints == {}
    robot.step(1)
    assert robot.setpoints == {"arm": pytest.approx(0.5, abs=0.02), "wheel": 0.0, "lift": 0.0}
    robot.setpoints.clear()
    robot.carry("arm", 0.5 + speed / 2.0, speed)
    assert robot.states("s") == ["running"]
    assert robot.setpoints.keys() == JOINTS.keys()
    robot.carry("arm", robot.setpoints["arm"], speed)
    robot.stuck.clear()
    robot.step(round((STANDSTILL_S + 0.1) / DT))
    assert robot.states("s") == ["running", "succeeded"]
    robot.setpoints.clear()
    robot.step(100)
    assert robot.setpoints == {}


def test_a_joint_outside_its_limits_is_held_where_it_stands() -> None:
    """By a stop, and by the end of a motion in which it was stuck and pushed out."""
    robot = Robot(arm=3.2)
    robot.stop("s")
    robot.step(30)
    assert robot.positions["arm"] == 3.2
    robot.stuck.add("arm")
    robot.move("m", arm=2.0)
    robot.carry("arm", 3.3)
    robot.step(300)
    assert robot.states("m") == ["running", "failed"]
    assert robot.setpoints["arm"] == pytest.approx(3.3)


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-0.2, 0.2), st.floats(0.3, 1.0))
def test_joints_arrive_together_and_on_a_straight_line(arm: float, wheel: float, lift: float, scale: float) -> None:
    """At any time each joint has completed the same share of its way, within the announced duration."""
    robot = Robot()
    duration_s = robot.move("m", scale=scale, arm=arm, wheel=wheel, lift=lift)
    robot.step(math.ceil(duration_s / DT) + 1)
    shares = [
        [at / target for at in robot.paths[name]]
        for name, target in (("arm", arm), ("wheel", wheel), ("lift", lift))
        if abs(target) > 1e-6
    ]
    for column in zip(*shares, strict=True):
        assert max(column) - min(column) <= 1e-6
        assert max(column) <= 1.0 + 1e-9
    assert robot.positions == {"arm": arm, "wheel": wheel, "lift": lift}


def test_joints_that_move_already_still_arrive_together() -> None:
    """They are redirected while moving, one of them backwards: both come to rest at the same step."""
    robot = Robot()
    robot.move("a", arm=2.0, wheel=2.0)
    robot.step(100)
    duration_s = robot.move("b", arm=-1.0, wheel=3.0)
    robot.step(round(duration_s / DT) + 20)
    arm, wheel = (
        next(index for index, at in enumerate(robot.paths[name]) if at == robot.paths[name][-1])
        for name in ("arm", "wheel")
    )
    assert abs(arm - wheel) <= 1
    assert robot.states("b") == ["running", "succeeded"]


def test_the_duration_that_is_said_is_that_of_the_motion() -> None:
    """Ramp and cruise; half as fast at half the scale; a speed limit of one joint, less a tenth, applies to all."""
    robot = Robot()
    assert robot.move("a", arm=1.6) == pytest.approx(1.6 / 0.8 + 0.4)
    robot.step(239)
    assert robot.states("a") == ["running"]
    robot.step(2)
    assert robot.states("a") == ["running", "succeeded"]
    assert robot.move("b", scale=0.5, arm=0.0) == pytest.approx(1.6 / 0.4 + 0.4)
    assert Robot().move("c", speeds={"wheel": 0.1}, arm=0.5, wheel=1.0) == pytest.approx(1.0 / 0.09 + 0.4)
    assert Robot().move("d", arm=0.05) == pytest.approx(2 * math.sqrt(0.05 * 0.4 / 0.8))
    assert Robot().move("e", arm=0.0) == 0.0


def test_a_path_is_followed_to_its_end() -> None:
    robot = Robot()
    assert robot.follow("f", [1.0, 2.0, 4.0], arm=[0.3, 0.6, -0.1], wheel=[0.1, 0.0, 0.2]) == 4.0
    robot.step(100)
    assert (robot.positions["arm"], robot.positions["wheel"]) == pytest.approx((0.3, 0.1))
    robot.step(302)
    assert (robot.positions["arm"], robot.positions["wheel"]) == (-0.1, 0.2)
    assert robot.states("f") == ["running", "succeeded"]


def test_a_path_starts_with_the_speed_that_the_joint_has() -> None:
    """The speed does not jump where a path takes over a moving joint."""
    robot = Robot()
    robot.move("a", arm=2.0)
    robot.step(100)
    robot.follow("f", [1.0, 3.0], arm=[1.1, 0.5])
    robot.step(400)
    speeds = [(b - a) / DT for a, b in itertools.pairwise(robot.paths["arm"])]
    assert max(abs(b - a) for a, b in itertools.pairwise(speeds)) < 0.1
    assert robot.end("a") == Outcome("a", "preempted", ("arm",), "replaced by command f", robot.end("a").progress, "f")
    assert robot.end("f").state == "succeeded"


def test_a_path_that_momentum_would_carry_beyond_a_limit_brakes_before_it_or_is_refused() -> None:
    """A slow path has time to brake; one that must be at the limit at once does not."""
    robot = Robot(arm=2.0)
    robot.move("a", arm=3.0)
    robot.step(140)
    with pytest.raises(ImpossibleError, match="beyond its limit"):
        robot.follow("f", [0.5, 1.0], arm=[3.0, 3.0])
    robot.follow("g", [20.0], arm=[2.9])
    robot.step(2_100)
    assert max(robot.paths["arm"]) <= 3.0
    assert robot.positions["arm"] == 2.9
    assert robot.end("g").state == "succeeded"


def test_progress_grows_from_nothing_to_one() -> None:
    robot = Robot()
    robot.move("a", arm=1.0)
    said = []
    for _ in range(30):
        said += [outcome.progress for outcome in robot.motions.running_progress()]
        robot.step(10)
    assert said[0] == robot.outcomes[0].progress == 0.0
    assert said == sorted(said)
    assert 10 < len(set(said)) < 20
    assert robot.end("a") == Outcome("a", "succeeded", ("arm",), progress=1.0)


def test_a_newer_motion_preempts_the_whole_older_one() -> None:
    """The older command ends once and names its successor; its other joint comes to rest short of its target."""
    robot = Robot()
    robot.move("a", arm=1.0, wheel=5.0)
    robot.step(50)
    assert robot.motions.preemptible_ids(["arm"]) == ("a",)
    robot.move("b", arm=-1.0)
    assert robot.states("a") == ["running", "preempted"]
    assert robot.end("a").successor == "b"
    robot.step(1_000)
    assert robot.states("b") == ["running", "succeeded"]
    assert robot.positions["wheel"] < 1.0


@pytest.mark.parametrize("target", [0.1, 2.0])
def test_a_stuck_joint_fails_and_is_no_longer_pushed(target: float) -> None:
    """The reason names the joint and its effort limit; the setpoint returns to the joint's position."""
    robot = Robot()
    robot.stuck = {"arm"}
    robot.move("a", arm=target)
    robot.step(round((SETTLE_S + 3.0) / DT))
    assert robot.states("a") == ["running", "failed"]
    assert "arm is at its effort limit" in robot.end("a").reason
    robot.step(round(4.0 / DT))
    robot.stuck = set()
    robot.step(10)
    assert robot.positions["arm"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("goal", [1.0, 0.5001, -2.2222, 0.0103])
@pytest.mark.parametrize("ticks", [4096, 8192, 1024, 0])
def test_a_joint_arrives_as_near_as_its_sensor_can_show(ticks: int, goal: float) -> None:
    robot = Robot()
    robot.stuck.add("arm")
    robot.move("m", arm=goal)
    for _ in range(600):
        true = robot.setpoints.get("arm", 0.0)
        robot.shown["arm"] = round(true / math.tau * ticks) / ticks * math.tau if ticks else true
        robot.step(1)
    assert robot.states("m") == ["running", "succeeded"]


@pytest.mark.parametrize(
    ("declared", "state"),
    [
        ({}, "failed"),
        ({"tolerance": 0.001}, "failed"),
        ({"tolerance": 0.02}, "succeeded"),
        ({"resolution": 0.009}, "failed"),
        ({"resolution": 0.011}, "succeeded"),
        ({"resolution": 0.011, "tolerance": 0.001}, "failed"),
    ],
)
def test_a_joint_that_sags_arrives_within_the_tolerance_that_its_driver_declares(
    declared: dict[str, float], state: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(JOINTS, "arm", replace(ARM, **declared))
    robot = Robot()
    robot.stuck.add("arm")
    robot.move("m", arm=1.0)
    for _ in range(round((2.0 + SETTLE_S) / DT)):
        robot.shown["arm"] = robot.setpoints.get("arm", 0.0) * 0.99
        robot.step(1)
    assert robot.end("m").state == state
    assert robot.states("m") == ["running", state]


@pytest.mark.parametrize(("share", "begins_s"), [(0.05, 0.0), (0.3, 0.0), (0.9, 0.0), (2.0, 0.8)])
def test_a_slow_joint_is_late_and_not_stuck(share: float, begins_s: float) -> None:
    """Its setpoint waits for it, and so do the joints that move with it: they stay on the straight line."""
    robot = Robot()
    robot.stuck.add("arm")
    duration_s = robot.move("m", arm=2.0, wheel=2.0)
    speed, steps = share * 0.5, 0
    while robot.end("m").state == "running" and steps < 20_000:
        way = robot.setpoints.get("arm", 0.0) - robot.positions["arm"]
        if steps * DT >= begins_s:
            robot.positions["arm"] += math.copysign(min(abs(way), speed * DT), way)
        robot.step(1)
        steps += 1
        assert abs(robot.positions["wheel"] - robot.setpoints["arm"]) < 1e-6
        assert robot.setpoints["arm"] - robot.positions["arm"] <= 0.4
    assert robot.states("m") == ["running", "succeeded"]
    assert steps * DT >= max(duration_s, 2.0 / speed)


def test_a_joint_that_something_carries_away_ends_its_motion() -> None:
    robot = Robot()
    robot.stuck.add("arm")
    robot.move("m", arm=2.0)
    robot.carry("arm", -2.0)
    assert robot.states("m") == ["running", "failed"]


def test_a_joint_outside_its_limits_moves_back_slowly() -> None:
    robot = Robot(arm=3.1)
    duration_s = robot.move("m", arm=2.5)
    robot.step(round(duration_s / DT) + 10)
    assert robot.fastest("arm") <= OUTSIDE_SHARE * cruise_of(ARM) * (1 + 1e-6)
    assert robot.states("m") == ["running", "succeeded"]


@pytest.mark.parametrize("moved_to", [0.7, 1.3])
def test_a_motion_begins_where_something_else_has_moved_the_joint(moved_to: float) -> None:
    """A person or another controller moved it since the last motion: it does not jump back to its last setpoint."""
    robot = Robot()
    robot.move("a", arm=1.0)
    robot.step(300)
    assert robot.states("a") == ["running", "succeeded"]
    robot.carry("arm", moved_to)
    robot.paths["arm"] = [moved_to]
    robot.move("b", arm=0.5)
    robot.step(300)
    assert robot.fastest("arm") <= cruise_of(ARM) * (1 + 1e-6)
    assert robot.states("b") == ["running", "succeeded"]
    assert robot.positions["arm"] == 0.5


def test_a_demonstration_goes_on_from_where_something_else_has_moved_the_joint() -> None:
    """A person moved it while no gateway was there: it does not jump back when one comes."""
    robot = Robot([Sway("arm", 0.4, 2.0)])
    robot.step(150)
    robot.step(200, held=True)
    robot.carry("arm", robot.positions["arm"] + 1.0, held=True)
    robot.paths["arm"] = [robot.positions["arm"]]
    robot.step(300)
    assert robot.fastest("arm") <= cruise_of(ARM) * (1 + 1e-6)
    assert robot.positions["arm"] < 0.5


def test_a_halt_brakes_and_fails_running_motions() -> None:
    """The joint decelerates within its ramp, without a jump, and then stays still."""
    robot = Robot()
    robot.move("a", arm=2.0)
    robot.step(60)
    [failed] = robot.motions.halt("gateway lost")
    assert (failed.command_id, failed.state, failed.reason) == ("a", "failed", "gateway lost")
    robot.step(200)
    assert robot.paths["arm"][-1] == robot.paths["arm"][-2] < 1.0


def test_a_stop_cancels_running_motions_and_succeeds_when_all_joints_stand() -> None:
    """The joint decelerates within its ramp, and the stop succeeds only when it stands."""
    robot = Robot([Sway("wheel", 0.4, 2.0)])
    robot.move("a", arm=2.0, lift=0.1)
    robot.step(60)
    fast = robot.fastest("arm")
    assert robot.motions.stoppable_ids(list(JOINTS)) == ("a",)
    assert robot.stop("s") == pytest.approx(0.4, rel=0.1)
    assert robot.end("a") == Outcome("a", "cancelled", ("arm", "lift"), "stopped", robot.end("a").progress, "s")
    robot.step(20)
    assert robot.states("s") == ["running"]
    robot.step(60)
    assert robot.states("s") == ["running", "succeeded"]
    rested = dict(robot.positions)
    robot.step(500)
    assert robot.positions == rested
    assert robot.fastest("arm") == fast


def test_a_stop_of_one_joint_or_command_leaves_the_others_alone() -> None:
    robot = Robot()
    robot.move("a", arm=2.0)
    robot.move("b", wheel=1.0)
    robot.move("c", lift=0.1)
    robot.step(30)
    robot.stop("s", "arm")
    robot.stop("t", command="b")
    robot.stop("u", command="nothing-like-it")
    robot.step(500)
    assert [robot.end(name).state for name in "abcstu"] == ["cancelled"] * 2 + ["succeeded"] * 4
    assert [robot.end(name).successor for name in "abc"] == ["s", "t", ""]
    assert robot.end("u").joints == ()


def test_a_stop_is_repeated_overtaken_and_not_undone_by_another() -> None:
    """The same stop again is one stop, a second one leaves the first running, and a newer command preempts both."""
    robot = Robot()
    robot.move("a", arm=2.0)
    robot.step(60)
    robot.stop("s")
    robot.stop("s")
    robot.stop("t")
    robot.step(10)
    robot.move("b", arm=0.0)
    robot.step(500)
    assert robot.states("s") == ["running", "running", "preempted"]
    assert robot.states("t") == ["running", "preempted"]
    assert robot.end("t").successor == "b"
    assert robot.states("b") == ["running", "succeeded"]


def test_a_stop_that_cannot_be_measured_fails_and_says_so() -> None:
    """One joint keeps moving, and the sensor of another one contradicts itself."""
    robot = Robot()
    robot.stuck.add("arm")
    robot.stop("s")
    for _ in range(round((SETTLE_S + 0.5) / DT)):
        robot.positions["arm"] += 0.5 * DT
        robot.shown["wheel"] = 1.0 - robot.shown.get("wheel", 0.0)
        robot.step(1)
    assert robot.states("s") == ["running", "failed"]
    assert robot.end("s").reason.startswith(
        "not come to rest: arm; standstill cannot be measured: wheel; the sensor of wheel contradicts itself"
    )


def test_a_stop_goes_on_when_the_gateway_is_lost() -> None:
    robot = Robot()
    robot.move("a", arm=2.0)
    robot.step(60)
    robot.stop("s")
    assert not robot.motions.halt("gateway lost")
    robot.step(100, held=True)
    assert robot.states("s") == ["running", "succeeded"]


def test_a_command_takes_a_swaying_joint_over_for_good() -> None:
    """The demonstration pauses while held, and after a command the joint stays where the command moved it."""
    robot = Robot([Sway("arm", 0.4, 2.0)])
    robot.step(400)
    path = robot.paths["arm"]
    assert max(path) > 0.2
    assert min(path) < -0.2
    robot.motions.halt("gateway lost")
    robot.step(200, held=True)
    assert path[-1] == path[-100]
    robot.step(200)
    assert path[-1] != path[-200]
    robot.move("a", arm=0.5)
    robot.step(600)
    assert path[-1] == path[-100] == 0.5


def test_a_demonstration_that_was_stopped_stays_so_until_it_is_begun_anew() -> None:
    """It then sways around the position at which the stop left it, but not while a motion moves its joint."""
    robot = Robot([Sway("arm", 0.4, 2.0)])
    robot.step(130)
    robot.stop("s")
    assert robot.motions.swaying == frozenset()
    assert robot.motions.restart_demonstrations() == []  # it is still braking
    robot.step(6000)
    path = robot.paths["arm"]
    stood = path[-1]
    assert path[-5000] == stood
    assert robot.motions.restart_demonstrations() == ["arm"]
    assert robot.motions.restart_demonstrations() == []
    robot.step(400)
    assert max(path[-400:]) > stood + 0.2
    assert min(path[-400:]) < stood - 0.2


def test_an_unknown_position_never_succeeds() -> None:
    """NaN is within no tolerance."""
    robot = Robot()
    robot.move("a", arm=0.0)
    _, outcomes = robot.motions.step(DT, Measurements(dict.fromkeys(JOINTS, math.nan)))
    assert [outcome.state for outcome in outcomes] == ["failed"]
    assert outcomes[0].reason == "the position of arm is not known any more"


@pytest.mark.parametrize("turns", [-2, -1, 1, 3])
@pytest.mark.parametrize("goal", [-1.0, 0.3, 3.0])
def test_a_wheel_that_shows_angles_within_a_turn_goes_the_same_way_as_one_that_counts(turns: int, goal: float) -> None:
    """Its setpoints never jump by a turn, and it does not unwind the turns that it has made."""
    robot = Robot()
    robot.stuck.add("wheel")
    at = 0.0

    def turn(steps: int) -> None:
        nonlocal at
        for _ in range(steps):
            at = robot.setpoints.get("wheel", at)
            robot.shown["wheel"] = math.remainder(at, math.tau)
            robot.step(1)

    robot.move("m", wheel=turns * math.tau)
    turn(5_000)
    assert robot.states("m") == ["running", "succeeded"]
    began = at
    robot.move("n", wheel=goal)
    turn(1_000)
    assert robot.states("n") == ["running", "succeeded"]
    assert at - began == pytest.approx(goal)


@given(st.floats(-2, 2), EVENTS)
def test_no_measurement_makes_a_setpoint_jump(start: float, events: list[Event]) -> None:
    """Whatever the sensor of the arm shows, its setpoints move no faster than the joint may."""
    robot = Robot(arm=start)
    robot.stuck.add("arm")
    for number, event in enumerate(events):
        if event.order == "stop":
            robot.stop(str(number))
        elif event.order == "move" and math.isfinite(robot.measured.positions["arm"]):
            robot.move(str(number), arm=event.size)
        frozen = robot.shown.get("arm", start)
        for cycle in range(event.cycles):
            true = robot.setpoints.get("arm", start)
            robot.shown["arm"] = shown_position(event, cycle, true, frozen)
            robot.step(1)
    for (at_s, before), (later_s, after) in itertools.pairwise(robot.sent):
        assert abs(after - before) <= rate_of(ARM) * (later_s - at_s) + 1e-8
