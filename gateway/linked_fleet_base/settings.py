"""Typed settings: sections of fields, each an environment variable and a flag, read once. Pure."""

import argparse
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from ipaddress import IPv4Network, IPv6Network, ip_network
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

T = TypeVar("T")
SectionT = TypeVar("SectionT", bound="Section")
Network = IPv4Network | IPv6Network


@dataclass(frozen=True)
class Kind(Generic[T]):
    """A type of settings, which parses text into a value."""

    read: Callable[[str], T]
    """Parses a text.

    The message of its ValueError completes the sentence "VARIABLE is ``right``, …", such as "not 'x'".
    """
    right: str
    """The valid values as text, such as "a whole number"."""


@dataclass(frozen=True)
class Setting:
    """One setting, with its name, default and meaning."""

    name: str
    """Name of the field in its section."""
    variable: str
    kind: Kind[Any]
    default: str
    meaning: str
    """One line of text. It refers to pages by their path in the repository."""

    @property
    def word(self) -> str:
        return self.variable.removeprefix("LINKED_FLEET_")

    @property
    def flag(self) -> str:
        return "--" + self.word.lower().replace("_", "-")

    def value(self, text: str) -> Any:
        """Parse a value. Raises ValueError with one sentence."""
        try:
            return self.kind.read(text)
        except ValueError as error:
            raise ValueError(f"{self.variable} is {self.kind.right}, {error}") from None


@dataclass(frozen=True)
class Section:
    """Base class of sections: frozen dataclasses whose fields are created by ``setting``."""

    prefix: ClassVar[str] = "LINKED_FLEET_"
    """Prefix of its environment variables."""

    @classmethod
    def settings(cls) -> list[Setting]:
        return [
            Setting(each.name, variable or cls.prefix + each.name.upper(), kind, default, meaning)
            for each in fields(cls)
            if "setting" in each.metadata
            for kind, default, meaning, variable in [each.metadata["setting"]]
        ]


def setting(kind: Kind[T], default: str, meaning: str, variable: str = "") -> T:
    """Return a field of a section.

    Its variable is the section's prefix and the field name, unless ``variable`` is given.
    """
    return field(default=kind.read(default), metadata={"setting": (kind, default, meaning, variable)})


def section(sections: Iterable[Section], kind: type[SectionT]) -> SectionT:
    """Return the section of this type. Raises LookupError."""
    for each in sections:
        if isinstance(each, kind):
            return each
    raise LookupError(f"{kind.__name__} is not among the sections that were read")


def read(
    sections: Sequence[type[Section]],
    environment: Mapping[str, str],
    arguments: Sequence[str],
    parser: argparse.ArgumentParser,
    *,
    others: bool = False,
) -> list[Section]:
    """Return the sections with their values. Flags precede the environment, where an empty variable counts as absent.

    Raises ValueError for an invalid value and for a variable of two sections, SystemExit for an unknown flag. With
    ``others``, unknown flags are left to other parsers.
    """
    owners: dict[str, str] = {}
    for kind in sections:
        for each in kind.settings():
            if other := owners.get(each.flag):
                raise ValueError(f"{each.variable} is a setting of both {other} and {kind.__name__}")
            owners[each.flag] = kind.__name__
            given = environment.get(each.variable) or each.default
            about = f"{each.meaning} ({each.variable})".replace("%", "%%")
            parser.add_argument(each.flag, dest=each.variable, metavar=each.word, default=given, help=about)
    texts = vars(parser.parse_known_args(arguments)[0] if others else parser.parse_args(arguments))
    return [kind(**{each.name: each.value(texts[each.variable]) for each in kind.settings()}) for kind in sections]


# -- kinds ------------------------------------------------------------------------------------------------------------


def whole_number(least: int = 0, most: int | None = None, noun: str = "whole number") -> Kind[int]:
    """Return a kind of whole numbers from ``least`` to ``most``."""

    def read(text: str) -> int:
        if (
            not re.fullmatch(r"\d{1,18}", text, re.ASCII)
            or int(text) < least
            or (most is not None and int(text) > most)
        ):
            raise _other(text)
        return int(text)

    return Kind(read, f"a {noun} from {least}" + ("" if most is None else f" to {most}"))


def choice(*words: str) -> Kind[str]:
    """Return a kind with a fixed list of words."""
    return text_matching("|".join(re.escape(each) for each in words), " or ".join(words))


def text_matching(pattern: str, right: str) -> Kind[str]:
    def read(text: str) -> str:
        if not re.fullmatch(pattern, text):
            raise _other(text)
        return text

    return Kind(read, right)


def comma_separated(kind: Kind[T], right: str) -> Kind[tuple[T, ...]]:
    """Return a kind of setting with comma-separated values of another kind."""
    return Kind(lambda text: tuple(kind.read(item.strip()) for item in text.split(",") if item.strip()), right)


def _other(text: str) -> ValueError:
    return ValueError(f"not {text!r}")


def _on_off(text: str) -> bool:
    if text not in ("on", "off"):
        raise _other(text)
    return text == "on"


def _network(text: str) -> Network:
    try:
        return ip_network(text)
    except ValueError as error:
        raise ValueError(f"and {error}") from None


def _ports(text: str) -> range:
    first, _, last = text.partition("-")
    numbers = [int(each) if re.fullmatch(r"\d{1,5}", each, re.ASCII) else 0 for each in (first, last or first)]
    if not 1 <= numbers[0] <= numbers[1] <= 65535:
        raise _other(text)
    return range(numbers[0], numbers[1] + 1)


TEXT = Kind(str, "a text")
FILE: Kind[Path | None] = Kind(lambda text: Path(text) if text else None, "a path")
ON_OFF = Kind(_on_off, "on or off")
PORT = whole_number(1, 65535, "port number")
TEXTS = comma_separated(TEXT, "a list of texts")
NETWORKS = comma_separated(Kind(_network, "a network"), "of networks such as 10.0.0.0/8")
PORTS = comma_separated(Kind(_ports, "a port or a range of ports"), "of ports such as 443 or 8000-8999")
