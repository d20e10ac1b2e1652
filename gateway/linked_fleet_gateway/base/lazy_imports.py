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


class LazyObjects(Generic[T]):
    """The objects of one kind, imported on first use. A name that cannot be imported is logged and left out."""

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self._objects: tuple[Any, ...] | None = None

    def replace(self, names: Iterable[str]) -> None:
        """Replace the names known to this process."""
        self.names, self._objects = tuple(names), None

    def __iter__(self) -> Iterator[T]:
        if self._objects is None:
            self._objects = tuple(self._resolve())
        return iter(self._objects)

    def _resolve(self) -> Iterator[Any]:
        for name in self.names:
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
