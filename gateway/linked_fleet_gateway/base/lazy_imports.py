"""Lazy imports of modules that take much memory and that most gateways never use."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any


class Lazily:
    """Imports the module ``name`` on first access.

    Raises ModuleNotFoundError at once if it or a need is not installed.
    """

    def __init__(self, name: str, *needs: str) -> None:
        for each in (name, *needs):
            if find_spec(each) is None:
                raise ModuleNotFoundError(f"{each} is not installed", name=each)
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        value = getattr(import_module(self._name), attribute)
        setattr(self, attribute, value)
        return value
