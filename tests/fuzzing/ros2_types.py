"""Types of ROS 2, their bytes and their descriptions, as nodes and users state them, in random and hostile variants."""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from fuzzing import mutation
from linked_fleet_agent.robots.ros2.configuration import ConfigurationError, read_configuration
from linked_fleet_agent.robots.ros2.definitions import FILLER, DefinitionError, read_text
from linked_fleet_agent.robots.ros2.distributions import distribution
from linked_fleet_agent.robots.ros2.serialization import CdrError
from linked_fleet_agent.robots.ros2.types import GET_TYPE_DESCRIPTION, MessageType, MessageTypes
from linked_fleet_agent.robots.ros2.views import View
from linked_fleet_agent.wire.schema import schema_problem, value_problem

_PRIMITIVES = (*range(2, 12), 13, 15, 16, 17, 21)
_STRANGE = (0, 1, 12, 14, 18, 22, 48, 49, 96, 97, 144, 145, 192, 255)
_CONFIGURATION = """expose = ["/lamp/*"]
deny = ["*/raw"]
[[property]]
topic = "/oven/temperature"
field = "temperature"
unit = "K"
write = true
[[event]]
topic = "/bumper"
rate_hz = 5
[[action]]
action = "/base/move"
moves = ["base"]
stop_s = 2
[component.oven]
title = "Oven"
[units]
"my_msgs/msg/Lamp.heat" = { unit = "K", term = "https://example.org/heat" }
"""
_FILE = """# a lamp
bool on true
float32[<=3] levels [0.5, 1]
string<=8 name "desk # lamp"
std_msgs/Header header
Colour[2] colours
uint8 RED=1
---
int32 count
"""


@cache
def _names() -> tuple[str, ...]:
    return tuple(name for name in distribution("jazzy") if name.split("/")[1] == "msg")


@cache
def _view(name: str) -> View | None:
    try:
        return View(_types().message(name))
    except DefinitionError:
        return None


@cache
def _types() -> MessageTypes:
    return MessageTypes()


def message(random: Random, torn: Callable[[Random, bytes], bytes]) -> None:
    """Check that bytes are a message whose JSON form conforms to its schema, or are refused."""
    name = random.choice(_names())
    payload = _payload(random, name, torn)
    try:
        said = _types().message(name).read(payload)
    except CdrError:
        return
    if (view := _view(name)) is not None and (value := view.value(said)) is not None:
        is_of_this = said.keys() == {field.name for field in _types().message(name).fields} - {FILLER}
        assert value_problem(view.schema, value) == "" or not is_of_this, name  # or of another distribution
        msgspec.json.encode(value)


def _payload(random: Random, name: str, torn: Callable[[Random, bytes], bytes]) -> bytes:
    """Return a message of defaults with random bytes after it, which lengths in it may reach."""
    good = _types().message(name).write({})
    return torn(random, good + random.randbytes(random.choice((0, 0, 4, 64, 1024))))


def description(random: Random, torn: Callable[[Random, bytes], bytes]) -> None:
    """Check that a description is a type whose messages go round, or is refused."""
    service = _types().service(GET_TYPE_DESCRIPTION)
    payload = service.response.write({"successful": True, "type_description": _description(random)})
    try:
        said = service.response.read(torn(random, payload) if random.random() < 0.5 else payload)
        type_ = MessageTypes().describe(said["type_description"])
    except (CdrError, DefinitionError):
        return
    _goes_round(type_)


def _goes_round(type_: MessageType) -> None:
    said = type_.read(type_.write({}), 2 * 1_048_576)
    assert type_.read(type_.write(said), 2 * 1_048_576) == said
    try:
        view = View(type_)
    except DefinitionError:
        return
    assert schema_problem(view.schema) == "", view.schema


def _description(random: Random) -> Mapping[str, Any]:
    names = [f"my_msgs/msg/T{number}" for number in range(random.randint(1, 6))]
    first, *others = [{"type_name": _text(random, name), "fields": _fields(random, names)} for name in names]
    return {"type_description": first, "referenced_type_descriptions": others}


def _fields(random: Random, names: list[str]) -> list[dict[str, Any]]:
    return [_field(random, f"f{number}", names) for number in range(random.choice((0, 1, 1, 2, 3, 80)))]


def _field(random: Random, name: str, names: list[str]) -> dict[str, Any]:
    number = random.choice(_PRIMITIVES) + random.choice((0, 0, 48, 96, 144))
    if random.random() < 0.3:
        number = 1 + random.choice((0, 48, 96, 144))
    if random.random() < 0.02:
        number = random.choice(_STRANGE)
    type_ = {
        "type_id": number,
        "capacity": random.choice((1, 2, 3, 3, 100, 65_536, 2**32)) if 48 <= number < 144 else 0,
        "string_capacity": random.choice((0, 1, 8)),
        "nested_type_name": random.choice(names) if number % 48 == 1 else "",
    }
    default = random.choice(("1", "True", "(1, 2)", "x", "[", "1e999", "\u00e9")) if random.random() < 0.05 else ""
    return {"name": _text(random, name), "type": type_, "default_value": default}


def _text(random: Random, text: str) -> str:
    if random.random() < 0.98:
        return text
    strange = random.choice(mutation.TEXTS).replace("\0", "").encode("utf-8", "replace").decode()
    return strange[:60]  # as long as the service carries


def interface_file(random: Random, _: object) -> None:
    """Check that the text of an interface file defines types, or is refused."""
    text = mutation.raw(random, _FILE.encode()).decode("utf-8", "replace")
    try:
        read_text(text, random.choice(("my_msgs/srv/Lamp", "my_msgs/msg/Lamp", "my_msgs/action/Lamp")))
    except DefinitionError:
        return


def configuration(random: Random, _: object) -> None:
    """Check that a file is a configuration, or is refused with its name."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "robot.toml"
        path.write_bytes(mutation.raw(random, _CONFIGURATION.encode()))
        try:
            read_configuration(path, "/arm")
        except ConfigurationError as error:
            assert str(error).startswith(str(path))
