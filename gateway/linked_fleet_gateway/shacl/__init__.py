"""SHACL shapes as Python: what pySHACL finds in milliseconds, found in microseconds.

``compile_shape`` makes a shape that judges the node it is given, ``compile_graph`` all shapes of a graph that have
targets. Both raise Unsupported with the reason at whatever they do not know, and pass over nothing.

Claimed of SHACL Core: targets, paths, severities, deactivated shapes and all components but those refused, as the
suite of the W3C has them (CONFORMANCE.md). Refused: ``sh:lessThan``, ``sh:lessThanOrEquals``, siblings that are
disjoint, inverses of paths that are no predicates, shapes that refer to themselves, datatypes whose lexical space is
not known here, limits that are no numbers, blank nodes as values, flags of patterns other than ``i``, entailment,
SPARQL, and components of one's own. Patterns are those of Python, as in pySHACL.

What is found is bounded (``check.MOST``), and so is the time: the data may be a stranger's, the shapes may not.
The package knows pyoxigraph and nothing of the gateway.
"""

from linked_fleet_gateway.shacl.check import CompiledGraph, CompiledShape
from linked_fleet_gateway.shacl.compiler import compile_graph, compile_shape
from linked_fleet_gateway.shacl.data import Data
from linked_fleet_gateway.shacl.report import Violation, report
from linked_fleet_gateway.shacl.stated import Unsupported

__all__ = [
    "CompiledGraph",
    "CompiledShape",
    "Data",
    "Unsupported",
    "Violation",
    "compile_graph",
    "compile_shape",
    "report",
]
