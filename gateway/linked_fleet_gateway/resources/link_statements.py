"""Statements about links that extensions add: pairs of a predicate and a path."""

from collections.abc import Callable, Iterable

from pyoxigraph import NamedNode

from linked_fleet_gateway.base.lazy_imports import Contributed
from linked_fleet_gateway.fleet.model import Link
from linked_fleet_gateway.fleet.robot import Robot

LINK_STATEMENTS = Contributed[Callable[[Robot, Link], Iterable[tuple[NamedNode, str]]]]()
