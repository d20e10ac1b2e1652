"""Checks of an order against the fleet as its client sees it."""

import time
from dataclasses import dataclass

from linked_fleet_base.errors import PayloadTooLarge
from linked_fleet_gateway.api import BadRequest, Core, UnprocessableContent
from linked_fleet_gateway.extensions.missions.mission import Mission
from linked_fleet_gateway.extensions.missions.targets import Targets
from linked_fleet_gateway.extensions.query.service import Queries
from linked_fleet_gateway.extensions.queue.needs import robot_at
from linked_fleet_gateway.extensions.queue.order import Choice, Wanted
from linked_fleet_gateway.extensions.queue.reading import deadline_ns
from linked_fleet_gateway.extensions.queue.records import place_of
from linked_fleet_gateway.extensions.rules.rule_invocation import find_action
from linked_fleet_gateway.faces import Identity, Tree


@dataclass(frozen=True)
class Checks:
    """Checks what is ordered: the mission exists, its client may run it, and its values conform to its shape."""

    core: Core
    targets: Targets
    queries: Queries

    async def check(self, wanted: Wanted, tree: Tree, caller: Identity) -> None:
        """Raise UnprocessableContent, InsufficientScope for an order that could not run."""
        if wanted.deadline and deadline_ns(wanted) <= time.time_ns():
            raise UnprocessableContent(f"The deadline {wanted.deadline} has passed; an order begins before it.")
        base, path = place_of(wanted.mission, (tree.view.base, *self.core.public_urls))
        offer = find_action(tree, path + "/actions/run", caller)
        mission = self.targets.missions[path.rpartition("/")[2]]
        values = dict(wanted.input)
        self._check_names(mission, wanted)
        if wanted.choice is not None:
            values[wanted.choice.parameter] = await self._sample(mission, wanted.choice, base, caller)
        if offer.takes_body and values:
            self.core.check_input(offer, base, self.core.statements(offer, base, values))
        if wanted.choice is None:
            kinds = {each.name: each for each in mission.parameters}
            typed = {
                name: (values.get(name, each.default), each.type)
                for name, each in kinds.items()
                if name in values or each.default is not None
            }
            await self.targets.check_run(mission, typed, base, tree, caller)  # type: ignore[arg-type]

    def _check_names(self, mission: Mission, wanted: Wanted) -> None:
        names = {each.name for each in mission.parameters}
        given = {*wanted.input, *([wanted.choice.parameter] if wanted.choice else [])}
        if unknown := sorted(given - names):
            has = f"has {', '.join(sorted(names))}" if names else "has none"
            raise UnprocessableContent(f"The mission has no parameter {', '.join(unknown)[:200]}; it {has}.")
        needed = {each.name for each in mission.parameters if each.default is None}
        if missing := sorted(needed - given):
            raise UnprocessableContent(f"The parameter {', '.join(missing)[:200]} has neither a value nor a choice.")

    async def _sample(self, mission: Mission, choice: Choice, base: str, caller: Identity) -> str:
        """Return a value that a choice may have. Raises UnprocessableContent."""
        parameter = next(each for each in mission.parameters if each.name == choice.parameter)
        if parameter.type != "iri":
            raise UnprocessableContent(
                f"The parameter {choice.parameter} is of the type {parameter.type}; robots are values of the type iri."
            )
        for each in choice.robots:
            robot = robot_at(each, base, self.core)
            if robot not in self.core.robots or not caller.visible_robots.includes(robot):
                raise UnprocessableContent(f"{each[:200]} is no robot of this fleet.")
        if choice.select:
            await self._check_select(choice.select, base, caller)
        return next(iter((*choice.robots, *parameter.options)), base + "/")

    async def _check_select(self, select: str, base: str, caller: Identity) -> None:
        try:
            await self.queries.check(select, base, caller.name)
        except (BadRequest, PayloadTooLarge) as error:
            raise UnprocessableContent(f"The query of the choice: {error.detail}") from error
