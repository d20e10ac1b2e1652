"""Links that checks of motions do not cover. Pure values."""

from collections.abc import Iterable

from msgspec import Struct
from pyoxigraph import NamedNode

from linked_fleet_state.closest import Closest

_MOST_NAMED = 3


class UncheckedLink(Struct, frozen=True):
    """A link that no check of motions covers.

    ``mesh`` is the URI of the mesh concerned, empty if it is another shape. ``reason`` says in words why.
    """

    link: str
    mesh: str
    reason: str


class Finding(Struct, frozen=True):
    """The result of the check of a path: ``free`` is False if it is unknown.

    ``unchecked`` are the links that the check did not cover, each after its path. The path is free for a drive at a
    ``speed_share`` of its speed, for the reason ``limited``, if that begins before ``until_ns`` of the robot's clock.
    ``closest`` is where a motion that is rehearsed comes closest to something.
    ``things`` are what it depends on, each a predicate and a path, which rehearsals state.
    """

    free: bool
    unchecked: tuple[tuple[str, UncheckedLink], ...] = ()
    speed_share: float = 1.0
    limited: str = ""
    until_ns: int = 0
    closest: Closest | None = None
    things: tuple[tuple[NamedNode, str], ...] = ()


def in_words(links: Iterable[UncheckedLink]) -> str:
    """Return the first links with their meshes and reasons, and the number of the others."""
    known = list(links)
    named = [f"{each.link} ({each.mesh + ': ' if each.mesh else ''}{each.reason})" for each in known[:_MOST_NAMED]]
    more = len(known) - len(named)
    return "; ".join(named) + (f"; and {more} more" if more else "")
