"""A simulated robot for an agent that reaches every setpoint at once, and checks the agent's promises."""

import itertools
import math
from collections.abc import Mapping

from fuzzing.good import ARM
from linked_fleet_agent.agent import Agent
from linked_fleet_agent.robot import Facts, JointFacts, Limits, Reading
from linked_fleet_agent.wire.codec import decode, decode_state
from linked_fleet_agent.wire.messages import Progress

_LIMITS = {"pan": Limits(-1.0, 1.0, 2.0, 3.0), "slide": Limits(-1.0, 1.0, 2.0, 3.0), "roll": Limits(velocity=2.0)}
FACTS = Facts(
    "An arm",
    ARM,
    (
        JointFacts("pan", limits=_LIMITS["pan"]),
        JointFacts("slide", linear=True, limits=_LIMITS["slide"]),
        JointFacts("roll", limits=_LIMITS["roll"], continuous=True),
        JointFacts("grip", mimics="pan"),
    ),
)
_ROUNDING = 1e-6


class BrokenPromiseError(AssertionError):
    """A setpoint that no robot may ever get."""


class Still:
    """A driver whose position is its last setpoint. Violations are stored in ``broken``.

    They are not raised, because the agent takes exceptions of a driver for a fault of the driver.
    """

    def __init__(self) -> None:
        self.at = dict.fromkeys(("pan", "slide", "roll", "grip"), 0.0)
        self.broken = ""
        self._now_s = self._before_s = 0.0

    def describe(self) -> Facts:
        return FACTS

    def read(self, now_s: float) -> Reading:
        self._before_s, self._now_s = self._now_s, now_s
        row = tuple(self.at.values())
        return Reading(row, (0.0,) * len(row), (0.0,) * len(row))

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        for name, position in setpoints.items():
            self._judge(name, position)
            self.at[name] = position
        return setpoints

    def _judge(self, name: str, position: float) -> None:
        limits, step = _LIMITS.get(name), self._now_s - self._before_s
        if limits is None:
            self.broken = f"a setpoint for {name!r}, which takes none"
        elif not math.isfinite(position) or limits.clamp(position) != position:
            self.broken = f"{name!r} is sent to {position!r}, out of {limits}"
        elif abs(position - self.at[name]) > (limits.velocity or math.inf) * step + _ROUNDING:
            self.broken = f"{name!r} is sent from {self.at[name]!r} to {position!r} within {step!r} s"

    def stop(self) -> None:
        """Do nothing: the robot never moves."""

    def close(self) -> None:
        """Do nothing: there is nothing to release."""


class CheckingLink:
    """A link that checks that all messages are well formed."""

    gateway_present = True
    arrivals = 1

    def watch_gateways(self, period_s: float) -> None:
        """Do nothing: a gateway is always present."""

    def publish_state(self, payload: bytes) -> None:
        decode_state(payload)

    def publish_condition(self, payload: bytes) -> None:
        """Ignore it."""

    publish_values = publish_event = publish_condition

    def publish_progress(self, payload: bytes, final: bool) -> None:
        decode(payload, Progress)


class AgentUnderTest:
    """An agent with its robot, link and clock."""

    def __init__(self) -> None:
        self.robot, self.ear = Still(), CheckingLink()
        self.now_ns = 10**12
        self._numbers = itertools.count()
        self.agent = Agent("arm", self.robot, monotonic_ns=lambda: self.now_ns, wall_ns=lambda: 10**18 + self.now_ns)
        self.pass_ms(10)

    def new_id(self) -> str:
        return f"c-{next(self._numbers)}"

    def pass_ms(self, duration_ms: int) -> None:
        """Let time pass; raises BrokenPromiseError if the agent sent the robot to a forbidden position."""
        self.now_ns += duration_ms * 1_000_000
        self.agent.tick(self.ear)
        if self.robot.broken:
            raise BrokenPromiseError(self.robot.broken)
