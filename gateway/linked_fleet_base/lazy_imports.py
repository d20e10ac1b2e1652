"""Modules that are imported when they are first used."""

import logging
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any, TypeVar

from linked_fleet_base.errors import LibraryMissing

T = TypeVar("T")
log = logging.getLogger(__name__)


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
