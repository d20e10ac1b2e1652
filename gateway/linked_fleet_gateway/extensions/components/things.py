"""Members of inputs that name things of the fleet.

Extensions add them, and guards of motions see them. Robots do not get them.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from msgspec.structs import replace

from linked_fleet_agent.wire.components import Action, Component
from linked_fleet_agent.wire.schema import Schema

_LONGEST = 2_000
Added = Mapping[tuple[str, str], Mapping[str, tuple[str, str]]]
"""``Extension.component_things``."""


class ThingSchema(Schema, frozen=True, kw_only=True):
    """The schema of the IRI of a thing."""


def with_things(components: Sequence[Component], additions: Iterable[Added]) -> list[Component]:
    """Return the components of a robot, whose actions take the members that extensions add."""
    found = list(components)
    for added in additions:
        for (kind, action), members in added.items():
            found = [_with_things(each, action, members) if each.semantic_type == kind else each for each in found]
    return found


def _with_things(component: Component, action: str, members: Mapping[str, tuple[str, str]]) -> Component:
    declared = component.actions.get(action)
    if declared is None or not declared.moves:
        return component  # no guard hears of what moves nothing
    given = declared.input or Schema(type="object")
    added = {
        name: ThingSchema(type="string", semantic_type=term, title=said, max_length=_LONGEST)
        for name, (term, said) in members.items()
        if name not in given.properties
    }
    taken = replace(declared, input=replace(given, properties={**given.properties, **added}))
    return replace(component, actions={**component.actions, action: taken})


def without_things(declared: Action | None, value: Any) -> Any:
    """Return an input, or the value of a property, as the robot gets it."""
    if declared is None or declared.input is None:
        return value
    known = declared.input.properties
    return {name: each for name, each in value.items() if not isinstance(known.get(name), ThingSchema)}
