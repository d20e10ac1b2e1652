"""Compilation of all shapes at start; a gateway does not start with a shape that cannot be compiled."""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from pyoxigraph import Triple

from linked_fleet_gateway.rdf.graph import Node
from linked_fleet_gateway.rdf.shapes import ACTIONS, BLUEPRINTS, SUBSCRIPTIONS, VOCABULARY, added_to, load
from linked_fleet_gateway.rdf.vocabulary import LF, RDF, SH
from linked_fleet_gateway.resources.action_conditions import CONDITIONS
from linked_fleet_gateway.resources.action_definition import definitions
from linked_fleet_gateway.resources.shape_parameters import COMPLETIONS
from linked_fleet_gateway.shacl import Unsupported, compile_shape


def check_shapes() -> None:
    """Compile all shapes of the core and of the registered extensions. Raises Unsupported with shape and reason.

    Shapes of actions are checked as written. The parts that COMPLETIONS adds for a robot come from code.
    """
    _check_all(*(added_to(name) for name in (ACTIONS, VOCABULARY, BLUEPRINTS)))


@cache
def _check_all(*added: tuple[Path, ...]) -> None:
    """Once for each set of files that extensions add."""
    for name in (VOCABULARY, BLUEPRINTS, SUBSCRIPTIONS):
        for node, about in load(name).items():
            if any(t.predicate == RDF.type and t.object == SH.NodeShape for t in about):
                _check(name, load(name), node)
    shapes = load(ACTIONS)
    for kind in definitions():
        if kind.consumes is not None:
            _check(f"{ACTIONS}/{kind.segment}", shapes, kind.consumes)
    completions = {t.object for about in shapes.values() for t in about if t.predicate == LF.completedBy}
    for unknown in completions.difference(COMPLETIONS):
        raise Unsupported(f"linked_fleet_shapes/{ACTIONS}: lf:completedBy {unknown} is not known")
    for kind in definitions():
        for unknown in set(kind.offered_if).difference(CONDITIONS):
            raise Unsupported(f"linked_fleet_shapes/{ACTIONS}: lf:offeredIf {unknown} is not known")


def _check(name: str, shapes: Mapping[Node, Sequence[Triple]], shape: Node) -> None:
    try:
        compile_shape(shapes, shape)
    except Unsupported as error:
        raise Unsupported(f"linked_fleet_shapes/{name}: {shape} cannot be compiled: {error}") from error
