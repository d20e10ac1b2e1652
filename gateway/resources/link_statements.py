"""Statements about links that extensions add: predicates and the paths that they lead to."""

from collections.abc import Callable, Iterable

from pyoxigraph import NamedNode

from gateway.base.contributed import Contributed
from gateway.fleet.model import Link
from gateway.fleet.robot import Robot

LINK_STATEMENTS = Contributed[Callable[[Robot, Link], Iterable[tuple[NamedNode, str]]]]()
