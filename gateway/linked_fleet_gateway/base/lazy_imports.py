"""Modules and objects that are imported when they are first used."""

import logging
from collections.abc import Iterable, Iterator
from importlib import import_module
from importlib.util import find_spec
from pkgutil import resolve_name
from types import ModuleType
from typing import Any, Generic, TypeVar

from linked_fleet_gateway.base.errors import LibraryMissing

T = TypeVar("T")
log = logging.getLogger(__name__)


class AddedObjects(Generic[T]):
    """The functions or classes of one kind that extensions add. Another process finds them by their names."""

    def __init__(self) -> None:
        self._objects: tuple[T, ...] = ()

    def replace(self, objects: Iterable[T]) -> None:
        """Replace the objects known to this process."""
        self._objects = tuple(objects)

    def replace_by_names(self, names: Iterable[str]) -> None:
        """Replace the objects by those with the names of another process. One that cannot be imported is left out."""
        self._objects = tuple(_resolved(names))

    @property
    def names(self) -> list[str]:
        """The names, as ``module:attribute``."""
        return [f"{each.__module__}:{getattr(each, '__qualname__', '')}" for each in self._objects]

    def __iter__(self) -> Iterator[T]:
        return iter(self._objects)


def _resolved(names: Iterable[str]) -> Iterator[Any]:
    for name in names:
        try:
            yield resolve_name(name)
        except Exception:  # whatever a foreign module raises must not hide the objects of others
            log.exception("%s of an extension cannot be imported and is left out", name)


class LazyModule:
    """Imports the module ``name`` on first access.

    Raises ModuleNotFoundError at once if it or a need is not installed. An access raises LibraryMissing if it is
    installed and cannot be loaded; the next access tries again.
    """

    def __init__(self, name: str, *needs: str) -> None:
        for each in (name, *needs):
            if find_spec(each) is None:
                raise ModuleNotFoundError(f"{each} is not installed", name=each)
        self._name, self._needs, self._logged = name, needs, False

    def __getattr__(self, attribute: str) -> Any:
        value = getattr(self._load(), attribute)
        setattr(self, attribute, value)
        return value

    def _load(self) -> ModuleType:
        try:
            return import_module(self._name)
        except ImportError as error:
            missing = LibraryMissing.for_module(self._needs[0] if self._needs else self._name, error)
            if not self._logged:
                log.error("%s", missing.detail)
                self._logged = True
            raise missing from error
