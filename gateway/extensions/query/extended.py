"""The process-wide part of extensions, told to the query process: it resolves the same tree as the gateway."""

from pathlib import Path

import msgspec

from gateway.rdf.shapes import added_to_folder
from gateway.resources.action_definition import FOLDER, add_kinds
from gateway.resources.fleet_functions import add_functions, added_functions
from gateway.resources.link_statements import add_link_statements, added_link_statements
from gateway.resources.paths import reserve, reserved_at_root, reserved_in_robot
from gateway.resources.property import add_robot_properties, added_robot_properties


class Extended(msgspec.Struct):
    """Reserved segments, files of kinds of actions, and ``module:attribute`` of what extensions add besides."""

    at_root: list[str]
    in_robot: list[str]
    kinds: list[str]
    robot_properties: list[str]
    link_statements: list[str]
    functions: list[str]


def extended() -> str:
    """The extensions of this process, as an argument of the query process."""
    kinds = [str(each) for each in added_to_folder(FOLDER)]
    known = Extended(
        sorted(reserved_at_root()),
        sorted(reserved_in_robot()),
        kinds,
        list(added_robot_properties()),
        list(added_link_statements()),
        list(added_functions()),
    )
    return msgspec.json.encode(known).decode()


def decode_extended(text: str) -> Extended:
    return msgspec.json.decode(text, type=Extended)


def extend(said: Extended) -> None:
    """Have this process know the same extensions."""
    reserve(said.at_root, said.in_robot)
    add_kinds(map(Path, said.kinds))
    add_robot_properties(said.robot_properties)
    add_link_statements(said.link_statements)
    add_functions(said.functions)
