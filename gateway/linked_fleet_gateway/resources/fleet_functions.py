"""Functions over the live fleet that extensions offer to languages of other extensions, such as SPARQL."""

from collections.abc import Callable, Mapping
from typing import Protocol

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_gateway.base.contributed import Contributed
from linked_fleet_gateway.fleet.robot import Robot

Term = NamedNode | BlankNode | Literal | Triple
Function = Callable[..., Term | None]
"""Gets terms and gives one; None is an error of the expression."""


class FleetFunctions(Protocol):
    """A class with the functions of one extension; a process makes one instance."""

    names: tuple[NamedNode, ...]

    def prepare(self) -> None:
        """Load all that calls will need: afterwards no file can be opened."""

    def bind(self, base: str, robots: Mapping[str, Robot]) -> Mapping[NamedNode, Function]:
        """The functions for these robots and no others. ``base``: the public URL without slash."""


FUNCTIONS = Contributed[Callable[[], FleetFunctions]]()
"""The classes of all extensions."""


def path_of(base: str, term: Term) -> str:
    """The path of a term in the fleet under ``base``; empty for what is not of it."""
    if isinstance(term, NamedNode) and term.value.startswith(base + "/"):
        return term.value[len(base) :]
    return ""
