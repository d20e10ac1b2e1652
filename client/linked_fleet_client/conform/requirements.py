"""All requirements of the paper, in its order."""

import inspect
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from linked_fleet_client.conform import linked, protocol, subscriptions
from linked_fleet_client.conform.subject import Subject
from linked_fleet_client.conform.verdict import Level, Outcome, Verdict, cant_tell
from linked_fleet_client.conform.web import OutOfTimeError


@dataclass(frozen=True)
class Requirement:
    name: str
    level: Level
    check: Callable[[Subject], Awaitable[Verdict]]

    @property
    def sentence(self) -> str:
        """The sentence of the paper."""
        return " ".join((inspect.getdoc(self.check) or "").split())


@dataclass(frozen=True)
class Result:
    requirement: Requirement
    verdict: Verdict

    @property
    def level(self) -> Level:
        return self.verdict.level or self.requirement.level

    @property
    def violates_must(self) -> bool:
        """True if the server violates a MUST."""
        return self.level is Level.MUST and self.verdict.outcome is Outcome.FAILED


REQUIREMENTS = (
    Requirement("R0.1", Level.MUST, protocol.r0_1),
    Requirement("R0.2", Level.SHOULD, protocol.r0_2),
    Requirement("R0.3", Level.MUST, protocol.r0_3),
    Requirement("R0.4", Level.MUST, protocol.r0_4),
    Requirement("R0.5", Level.MUST, protocol.r0_5),
    Requirement("R0.6", Level.MUST, protocol.r0_6),
    Requirement("R0.7", Level.SHOULD, protocol.r0_7),
    Requirement("R0.8", Level.MUST, protocol.r0_8),
    Requirement("R0.9", Level.MUST, protocol.r0_9),
    Requirement("R0.10", Level.MUST, protocol.r0_10),
    Requirement("R0.11", Level.MUST, protocol.r0_11),
    Requirement("R0.12", Level.MUST, subscriptions.r0_12),
    Requirement("R0.13", Level.SHOULD, subscriptions.r0_13),
    Requirement("R0.14", Level.MUST, subscriptions.r0_14),
    Requirement("R0.15", Level.MUST, subscriptions.r0_15),
    Requirement("R0.16", Level.MUST, subscriptions.r0_16),
    Requirement("R0.17", Level.SHOULD, subscriptions.r0_17),
    Requirement("R1.1", Level.MUST, linked.r1_1),
    Requirement("R1.2", Level.MUST, linked.r1_2),
    Requirement("R1.3", Level.MUST, linked.r1_3),
    Requirement("R1.4", Level.MUST, linked.r1_4),
    Requirement("R1.5", Level.SHOULD, linked.r1_5),
    Requirement("R1.6", Level.SHOULD, linked.r1_6),
    Requirement("R1.7", Level.MUST, linked.r1_7),
    Requirement("R1.8", Level.MUST, linked.r1_8),
    Requirement("R1.9", Level.SHOULD, linked.r1_9),
    Requirement("R1.10", Level.SHOULD, linked.r1_10),
    Requirement("R1.11", Level.MAY, linked.r1_11),
    Requirement("R1.12", Level.MAY, linked.r1_12),
)


async def check_all(subject: Subject) -> list[Result]:
    return [Result(requirement, await _checked(requirement, subject)) for requirement in REQUIREMENTS]


async def _checked(requirement: Requirement, subject: Subject) -> Verdict:
    try:
        return await requirement.check(subject)
    except OutOfTimeError as error:
        return cant_tell(str(error))
