"""Objects that extensions add to a process, by the names ``module:attribute`` of the objects."""

from collections.abc import Iterable, Iterator
from pkgutil import resolve_name
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class Contributed(Generic[T]):
    """The objects of one kind, imported when they are first asked for."""

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self._objects: tuple[Any, ...] | None = None

    def replace(self, names: Iterable[str]) -> None:
        """Have this process know these instead of those that it knew before."""
        self.names, self._objects = tuple(names), None

    def __iter__(self) -> Iterator[T]:
        if self._objects is None:
            self._objects = tuple(map(resolve_name, self.names))
        return iter(self._objects)
