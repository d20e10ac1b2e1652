"""Contributions: the additions of extensions to the tree of one gateway, one object for each gateway.

Code that runs for a gateway finds the object of that gateway by ``present()``. Tasks and threads inherit it from those
that start them (PEP 567); the application sets it for each request, and the link for messages of Zenoh.
"""

from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, cast

T = TypeVar("T")

CORE_AT_ROOT = frozenset(
    {"actions", "blueprint", "context", "health", "invocations", "linkset", "metrics", "scene"}
    | {"subscriptions", "vocabulary"}
)
"""Segments below ``/`` that are resources of the fleet itself."""
CORE_IN_ROBOT = frozenset(
    {"actions", "annotations", "blueprint", "invocations", "jointState", "lease", "linkset", "maximumSpeedScale"}
    | {"pose", "subscriptions", "title", "twist", "vocabulary"}
)
"""Segments below a robot that are resources of the robot itself."""


@dataclass(frozen=True, eq=False)
class Contributions:
    """The contributions of all extensions that are on, and the segments of all that are built in.

    The last five public fields are functions and classes whose types the rooms ``resources`` and ``http`` know.
    """

    at_root: frozenset[str] = CORE_AT_ROOT
    """All segments below ``/`` that are not robots: robots with these names are escaped."""
    in_robot: frozenset[str] = CORE_IN_ROBOT
    """All segments below a robot that are not parts of it: joints and links with these names are escaped."""
    public: frozenset[str] = frozenset()
    """Segments below ``/`` whose resources contain nothing about a fleet, so that everybody may read them."""
    files: Mapping[str, tuple[Path, ...]] = field(default_factory=dict)
    """Turtle files by the file or folder of shapes/linked_fleet_shapes that they are read with."""
    robot_properties: tuple[Any, ...] = ()
    link_statements: tuple[Any, ...] = ()
    introductions: tuple[Any, ...] = ()
    placements: tuple[Any, ...] = ()
    functions: tuple[Any, ...] = ()
    patches: Mapping[str, Any] = field(default_factory=dict)
    """Readers of bodies of PATCH by their media type."""
    _derived: dict[Hashable, Any] = field(default_factory=dict)

    def derived(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return what ``make`` returned for this key first. It depends on the contributions alone."""
        found = self._derived.get(key)
        if found is None:
            found = self._derived[key] = make()
        return cast(T, found)


_present: ContextVar[Contributions] = ContextVar("contributions", default=Contributions())  # noqa: B039 - immutable


def present() -> Contributions:
    """Return the contributions to the gateway for which this code runs; none outside of a gateway."""
    return _present.get()


def set_present(contributions: Contributions) -> None:
    """Set the contributions for the rest of this task, thread or callback, and for all that it starts."""
    _present.set(contributions)


@contextmanager
def using(contributions: Contributions) -> Iterator[None]:
    """Set the contributions for a block."""
    token = _present.set(contributions)
    try:
        yield
    finally:
        _present.reset(token)
