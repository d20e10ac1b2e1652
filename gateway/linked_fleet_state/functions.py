"""Functions over the live fleet that an extension offers to query languages of other extensions, such as SPARQL."""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_base.contributions import present
from linked_fleet_state.robot import Robot

Term = NamedNode | BlankNode | Literal | Triple
Function = Callable[..., Term | None]
"""Maps terms to a term; None is an expression error."""


class FleetFunctions(Protocol):
    """The functions of one extension; a process creates one instance."""

    @property
    def names(self) -> tuple[NamedNode, ...]: ...

    def prepare(self) -> None:
        """Load everything that calls need: afterwards no file can be opened. Raises LibraryMissing."""

    def bind(self, base: str, robots: Mapping[str, Robot]) -> Mapping[NamedNode, Function]:
        """Return the functions for these robots only. ``base`` is the public URL without trailing slash."""


def added_functions() -> Sequence[Callable[[], FleetFunctions]]:
    """Return the classes of functions that extensions add."""
    return present().functions


def path_of(base: str, term: Term) -> str:
    """Return the path of a term in the fleet under ``base``; empty for other terms."""
    if isinstance(term, NamedNode) and term.value.startswith(base + "/"):
        return term.value[len(base) :]
    return ""
