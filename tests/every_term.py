"""The terms of the core and of all extensions that come with the gateway."""

from importlib import import_module
from importlib.util import find_spec

from linked_fleet_gateway.app.extensions import BUILT_IN
from linked_fleet_gateway.rdf.vocabulary import LF as CORE

_MODULES = [f"linked_fleet_gateway.extensions.{each.name}.terms" for each in BUILT_IN]
LF = CORE.extended(" ".join(" ".join(import_module(name).LF.terms) for name in _MODULES if find_spec(name)))
