"""Conditions of steps that wait: SPARQL SELECTs over the live fleet, with the rights of who runs the mission."""

from dataclasses import dataclass

from linked_fleet_base.errors import PayloadTooLarge
from linked_fleet_gateway.api import BadRequest, UnprocessableContent
from linked_fleet_gateway.extensions.missions.findings import Findings
from linked_fleet_gateway.extensions.missions.mission import Mission, Wait, walk_paths
from linked_fleet_gateway.extensions.query.service import Queries
from linked_fleet_gateway.faces import Identity

_CLIENT = "missions"
"""Client of the queries of missions, so that no queries of others count for it."""


@dataclass(frozen=True)
class Conditions:
    """Checks and evaluates conditions."""

    queries: Queries

    async def check(self, mission: Mission, base: str, caller: Identity) -> None:
        """Raise UnprocessableContent for a condition that is no SPARQL SELECT with named variables."""
        findings = Findings()
        for path, step in walk_paths(mission.step):
            if isinstance(step, Wait) and step.condition:
                with findings.at(path, step):
                    try:
                        await self.queries.check(step.condition, base, caller.name)
                    except (BadRequest, PayloadTooLarge) as error:
                        raise UnprocessableContent(f"The condition of a step: {error.detail}") from error
        findings.check()

    async def holds(self, condition: str, base: str, caller: Identity) -> bool:
        """Return True if a condition has an answer. Raises as ``Queries.select``."""
        return bool(await self.queries.select(condition, base, caller.visible_robots, client=_CLIENT))
