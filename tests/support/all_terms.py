"""The terms of the core and of all extensions that come with the gateway."""

from importlib import import_module
from pathlib import Path

import linked_fleet_gateway.extensions
from linked_fleet_rdf.vocabulary import LF as CORE

_FILES = [
    each
    for each in sorted(Path(linked_fleet_gateway.extensions.__path__[0]).glob("*/*.py"))
    if "\nLF = CORE.extended(" in each.read_text()
]
_MODULES = [f"linked_fleet_gateway.extensions.{each.parent.name}.{each.stem}" for each in _FILES]
LF = CORE.extended(" ".join(" ".join(import_module(name).LF.terms) for name in _MODULES))
