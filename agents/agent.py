"""The loop of one robot: read → publish; command → judge → move → report. Knows only Robot and Link."""

import asyncio
import logging
import math
import secrets
import time
from collections.abc import Callable, Iterable
from typing import Protocol

from agents import safety
from agents.motion import Motions, Outcome, Sway
from agents.robot import Reading, Robot
from agents.wire import codec
from agents.wire.codec import VersionError, WireError
from agents.wire.messages import WIRE_VERSION, Accepted, Base, Command, Description, Progress, Refused, Reply, State

_log = logging.getLogger(__name__)


class Link(Protocol):
    """The way to the gateways. Neither publication ever blocks or raises: a lost link drops, and says so in the log."""

    @property
    def gateway_present(self) -> bool:
        """Whether at least one gateway is known to be alive."""

    def publish_state(self, payload: bytes) -> None: ...

    def publish_progress(self, payload: bytes) -> None: ...


def new_incarnation() -> int:
    """A number for this run of an agent: it grows with wall time, differs between simultaneous starts, fits 63 bits."""
    return (time.time_ns() // 1_000_000) * 4096 + secrets.randbelow(4096)


class Agent:
    """One robot. ``description`` and ``incarnation`` never change; everything runs on one event loop.

    Raises ValueError when a demonstration names a joint that takes no command.
    """

    def __init__(
        self,
        name: str,
        robot: Robot,
        *,
        rate_hz: float = 100.0,
        sways: Iterable[Sway] = (),
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self.name, self.rate_hz = name, rate_hz
        self.incarnation = new_incarnation()
        self._robot, self._facts = robot, robot.describe()
        self._joints = {joint.name: joint for joint in self._facts.joints}
        self._names = tuple(self._joints)
        sways = tuple(sways)
        for sway in sways:
            if sway.joint not in self._joints or self._joints[sway.joint].mimics is not None:
                raise ValueError(f"{name} has no joint {sway.joint!r} that takes commands")
        self._motions = Motions(self._joints, sways)
        self._monotonic_ns, self._wall_ns = monotonic_ns, wall_ns
        self._seen = safety.Remembered()
        self._measured: dict[str, float] = dict.fromkeys(self._names, math.nan)
        self._sequence = 0
        self._stepped_ns: int | None = None
        self._gateway_present = False
        self._fault: str | None = None
        self._outcomes: list[Outcome] = []
        self.description = codec.encode(self._describe())

    async def run(self, link: Link) -> None:
        """Tick at ``rate_hz`` until cancelled, then hold and close the robot. Missed ticks are skipped, not made up."""
        loop, period_s = asyncio.get_running_loop(), 1.0 / self.rate_hz
        due_s = loop.time()
        try:
            while True:
                self.tick(link)
                due_s = max(due_s + period_s, loop.time() - period_s)
                await asyncio.sleep(max(0.0, due_s - loop.time()))
        finally:
            self._outcomes += self._motions.halt("the agent ends")
            self._report(link)
            self._stop_robot()
            self._robot.close()

    def tick(self, link: Link) -> None:
        """Read, publish, hold if nobody is there any more, and move on."""
        now_ns = self._monotonic_ns()
        reading = self._read(now_ns)
        self._publish_state(link, now_ns, reading)
        self._watch_gateways(link.gateway_present)
        if reading is not None:
            self._move(now_ns, reading)
        self._report(link)

    def handle(self, payload: bytes) -> bytes:
        """Judge one command; the reply says accepted or why not. Never raises."""
        try:
            command = codec.decode(payload, Command)
        except VersionError as error:
            return codec.encode(Refused("", "version", str(error)[:1024]))
        except WireError as error:
            return codec.encode(Refused("", "malformed", str(error)[:1024]))
        reply = self._judge(command)
        if isinstance(reply, Refused):
            _log.info("%s: command %s refused (%s): %s", self.name, reply.id, reply.code, reply.reason)
        else:
            self._seen.add(command.id)
            targets = safety.clamp(command.motion.targets, self._joints)
            self._outcomes += self._motions.start(command.id, targets, self._measured)
        return codec.encode(reply)

    def _judge(self, command: Command) -> Reply:
        verdict = safety.judge(
            command,
            now_ns=self._monotonic_ns(),
            incarnation=self.incarnation,
            joints=self._joints,
            seen=self._seen,
        )
        if isinstance(verdict, Refused):
            return verdict
        if self._fault is not None:
            return Refused(command.id, "fault", f"the robot has a fault: {self._fault}"[:1024])
        if not self._gateway_present:
            return Refused(command.id, "fault", "no gateway is present, and without one the robot holds")
        unknown = [name for name in command.motion.targets if not math.isfinite(self._measured[name])]
        if unknown:
            return Refused(command.id, "fault", f"the position of {', '.join(unknown)} is unknown"[:1024])
        return Accepted(command.id)

    def _read(self, now_ns: int) -> Reading | None:
        try:
            reading = self._robot.read(now_ns / 1e9)
        except Exception as error:  # noqa: BLE001 - a driver may raise whatever its hardware library does
            self._fail(error, "read")
            return None
        if self._fault is not None:
            _log.warning("%s: the robot can be read again", self.name)
            self._fault = None
        self._measured = dict(zip(self._names, reading.positions, strict=True))
        return reading

    def _fail(self, error: Exception, doing: str) -> None:
        reason = f"{doing} failed: {error or type(error).__name__}"
        if self._fault is None:
            _log.exception("%s: %s; the robot holds", self.name, reason)
            self._stop_robot()
        self._fault = reason
        self._measured = dict.fromkeys(self._names, math.nan)
        self._outcomes += self._motions.forget(f"driver fault: {reason}"[:1024])

    def _stop_robot(self) -> None:
        try:
            self._robot.stop()
        except Exception:  # noqa: BLE001 - as in _read
            _log.exception("%s: the robot could not be stopped", self.name)

    def _publish_state(self, link: Link, now_ns: int, reading: Reading | None) -> None:
        if reading is None:
            unknown = (math.nan,) * len(self._names)
            nans: tuple[float, float, float] = (math.nan, math.nan, math.nan)
            base = Base(nans, (*nans, math.nan), nans, nans) if self._facts.floating else None
            reading = Reading(unknown, unknown, unknown, base)
        state = State(
            incarnation=self.incarnation,
            sequence=self._sequence,
            monotonic_ns=now_ns,
            wall_ns=self._wall_ns(),
            base=reading.base,
            positions=reading.positions,
            velocities=reading.velocities,
            efforts=reading.efforts,
        )
        self._sequence += 1
        link.publish_state(codec.encode_state(state))

    def _watch_gateways(self, present: bool) -> None:
        if self._gateway_present and not present:
            _log.warning("%s: the last gateway is gone; the robot holds", self.name)
            self._outcomes += self._motions.halt("gateway lost")
        elif present and not self._gateway_present:
            _log.info("%s: a gateway is present", self.name)
        self._gateway_present = present

    def _move(self, now_ns: int, reading: Reading) -> None:
        elapsed_s = 0.0 if self._stepped_ns is None else (now_ns - self._stepped_ns) / 1e9
        self._stepped_ns = now_ns
        efforts = dict(zip(self._names, reading.efforts, strict=True))
        setpoints, outcomes = self._motions.step(elapsed_s, self._measured, efforts, held=not self._gateway_present)
        self._outcomes += outcomes
        if setpoints:
            try:
                self._motions.correct(self._robot.apply(setpoints))
            except Exception as error:  # noqa: BLE001 - as in _read
                self._fail(error, "apply")

    def _report(self, link: Link) -> None:
        for outcome in self._outcomes:
            measured = {joint: self._measured[joint] for joint in outcome.joints}
            progress = Progress(
                version=WIRE_VERSION,
                id=outcome.command_id,
                incarnation=self.incarnation,
                state=outcome.state,
                wall_ns=self._wall_ns(),
                reason=outcome.reason,
                positions={joint: position for joint, position in measured.items() if math.isfinite(position)},
            )
            link.publish_progress(codec.encode(progress))
        self._outcomes.clear()

    def _describe(self) -> Description:
        floating = self._facts.floating
        return Description(
            version=WIRE_VERSION,
            robot=self.name,
            incarnation=self.incarnation,
            title=self._facts.title,
            urdf=self._facts.urdf,
            base="floating" if floating else "fixed",
            joints=self._names,
            rate_hz=self.rate_hz,
            capabilities=("move",),
            annotations=self._facts.annotations,
            layout=codec.layout(len(self._names), floating),
        )
