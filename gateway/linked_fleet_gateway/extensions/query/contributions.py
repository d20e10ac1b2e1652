"""Process-wide contributions of extensions, passed to the query process so that it resolves the same tree."""

from pathlib import Path

import msgspec

from linked_fleet_gateway.rdf.shapes import ACTIONS, BLUEPRINTS, VOCABULARY, add, added_to
from linked_fleet_gateway.resources.action_definition import add_kinds
from linked_fleet_gateway.resources.fleet_functions import FUNCTIONS
from linked_fleet_gateway.resources.paths import reserve, reserved_at_root, reserved_in_robot
from linked_fleet_gateway.resources.property import LINK_STATEMENTS, ROBOT_PROPERTIES
from linked_fleet_gateway.resources.relative_poses import PLACEMENTS


class Contributions(msgspec.Struct):
    """Reserved segments, Turtle files, and ``module:attribute`` names of other contributions."""

    at_root: list[str]
    in_robot: list[str]
    files: dict[str, list[str]]
    robot_properties: list[str]
    link_statements: list[str]
    functions: list[str]
    placements: list[str]


def contributions() -> str:
    """Return the contributions in this process as an argument of the query process."""
    known = Contributions(
        sorted(reserved_at_root()),
        sorted(reserved_in_robot()),
        {name: [str(each) for each in added_to(name)] for name in (ACTIONS, VOCABULARY, BLUEPRINTS)},
        list(ROBOT_PROPERTIES.names),
        list(LINK_STATEMENTS.names),
        list(FUNCTIONS.names),
        list(PLACEMENTS.names),
    )
    return msgspec.json.encode(known).decode()


def decode_contributions(text: str) -> Contributions:
    return msgspec.json.decode(text, type=Contributions)


def register(said: Contributions) -> None:
    """Register the same contributions in this process."""
    reserve(said.at_root, said.in_robot)
    add_kinds(map(Path, said.files[ACTIONS]))
    for name in (VOCABULARY, BLUEPRINTS):
        add(name, map(Path, said.files[name]))
    ROBOT_PROPERTIES.replace(said.robot_properties)
    LINK_STATEMENTS.replace(said.link_statements)
    FUNCTIONS.replace(said.functions)
    PLACEMENTS.replace(said.placements)
