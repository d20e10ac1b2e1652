"""Objects that extensions contribute to a process, named ``module:attribute``."""

from collections.abc import Iterable, Iterator
from pkgutil import resolve_name
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class Contributed(Generic[T]):
    """The objects of one kind, imported on first use."""

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self._objects: tuple[Any, ...] | None = None

    def replace(self, names: Iterable[str]) -> None:
        """Replace the names known to this process."""
        self.names, self._objects = tuple(names), None

    def __iter__(self) -> Iterator[T]:
        if self._objects is None:
            self._objects = tuple(map(resolve_name, self.names))
        return iter(self._objects)
