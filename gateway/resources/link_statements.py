"""Statements about links that extensions add: predicates and the paths that they lead to."""

from collections.abc import Callable, Iterable
from functools import cache
from importlib import import_module

from pyoxigraph import NamedNode

from gateway.fleet.model import Link
from gateway.fleet.robot import Robot

Statements = Callable[[Robot, Link], Iterable[tuple[NamedNode, str]]]

_added: tuple[str, ...] = ()


def add_link_statements(names: Iterable[str]) -> None:
    """Have this process say more of links, by ``module:attribute`` of ``Statements``, instead of those added before."""
    global _added
    _added = tuple(names)
    _makers.cache_clear()


def added_link_statements() -> tuple[str, ...]:
    return _added


def further_statements(robot: Robot, link: Link) -> list[tuple[NamedNode, str]]:
    """The statements about a link that were added."""
    return [each for make in _makers() for each in make(robot, link)]


@cache
def _makers() -> tuple[Statements, ...]:
    named = (name.partition(":") for name in _added)
    return tuple(getattr(import_module(module), attribute) for module, _, attribute in named)
