"""The sources of definitions of types: distributions of ROS 2, and folders of interface files.

rosbags has the messages of each distribution. The folder ``interfaces`` has what it lacks and robots need, as field
lists: services, actions and messages of ros2_control, Nav2 and robots of Universal Robots.
"""

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from linked_fleet_agent.robots.ros2.definitions import (
    MAX_TEXT,
    Arity,
    Definition,
    DefinitionError,
    Definitions,
    Field,
    checked,
    read_text,
)

DISTRIBUTIONS = ("jazzy", "kilted", "lyrical", "humble", "iron")
"""Distributions whose types are known, in the order in which they are tried for a type whose hash is not known."""
MAX_FILES = 20_000
_INTERFACES = Path(__file__).with_name("interfaces")
_SHARED = {"humble": ("before_jazzy",), "iron": ("before_jazzy",)}
_KINDS = ("msg", "srv", "action")
_PARTS = (
    "_Request",
    "_Response",
    "_Event",
    "_Goal",
    "_Result",
    "_Feedback",
    "_FeedbackMessage",
    "_SendGoal",
    "_GetResult",
)


class InterfaceFolder(Mapping[str, Definition]):
    """The interface files of a folder, read when they are asked for.

    It has folders of packages, as ``PACKAGE/msg/Name.msg``, or is a prefix of ROS with them in ``share``. A bad file
    raises DefinitionError when one of its types is asked for.
    """

    def __init__(self, folder: Path) -> None:
        self._files = dict[str, Path]()
        self._read = dict[str, Definition]()
        share = folder / "share"
        for kind in _KINDS:
            for file in sorted((share if share.is_dir() else folder).glob(f"*/{kind}/*.{kind}")):
                if len(self._files) >= MAX_FILES:
                    raise DefinitionError(f"{folder} has more than {MAX_FILES} interface files; name a smaller folder")
                self._files[f"{file.parent.parent.name}/{kind}/{file.stem}"] = file

    def __getitem__(self, name: str) -> Definition:
        stated = self._stated(name)
        if name not in self._read and stated:
            self._read.update({each.name: each for each in _read_file(self._files[stated], stated)})
        return self._read[name]

    def _stated(self, name: str) -> str:
        """Return the name of the file with a type, which is a part of it perhaps, or an empty string."""
        for _ in range(3):  # as of Name_SendGoal_Request
            if name in self._files:
                return name
            name, _, suffix = name.rpartition("_")
            if f"_{suffix}" not in _PARTS:
                break
        return ""

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and bool(self._stated(name))

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)


def _read_file(file: Path, name: str) -> list[Definition]:
    try:
        with file.open(encoding="utf-8") as opened:
            return read_text(opened.read(MAX_TEXT + 1), name)
    except (OSError, UnicodeDecodeError) as error:
        raise DefinitionError(f"{file} cannot be read: {error}") from error
    except DefinitionError as error:
        raise DefinitionError(f"{file}: {error}") from error


@cache
def distribution(name: str) -> Definitions:
    """Return the definitions of one of ``DISTRIBUTIONS``."""
    stated = get_typestore(Stores(f"ros2_{name}")).fielddefs
    of_rosbags = {type_: _definition(type_, *said) for type_, said in stated.items()}
    shared = [InterfaceFolder(_INTERFACES / each) for each in (*_SHARED.get(name, ()), "common")]
    return Definitions(InterfaceFolder(_INTERFACES / name), (*shared, of_rosbags))


def _definition(name: str, constants: Any, fields: Any) -> Definition:
    return checked(
        Definition(
            name,
            tuple(_field(each, *said) for each, said in fields),
            tuple((each, value) for each, _, value in constants),
        )
    )


def _field(name: str, node: int, said: Any) -> Field:
    arity: Arity = "one"
    size = 0
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        arity = "array" if node == Nodetype.ARRAY else "bounded" if said[1] else "sequence"
        (node, said), size = said
    if node == Nodetype.NAME:
        return Field(name, said, arity, size)
    type_, text_size = said
    return Field(name, "uint8" if type_ == "char" else type_, arity, size, text_size)
