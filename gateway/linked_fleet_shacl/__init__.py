"""A SHACL compiler: validates in microseconds with results equal to pySHACL, which takes milliseconds.

``compile_shape`` compiles a shape for a given focus node, ``Compiler`` several of one graph, ``compile_graph`` all
shapes of a graph that have targets. All raise Unsupported with the reason for any unknown construct; none is ignored.

Supported of SHACL Core: targets, paths, severities, deactivated shapes and all components but those refused, as tested
by the W3C suite (CONFORMANCE.md). Refused: ``sh:lessThan``, ``sh:lessThanOrEquals``,
``sh:qualifiedValueShapesDisjoint``, inverses of complex paths, recursive shapes, datatypes whose lexical space is
unknown here, limits that are not numbers, blank nodes as values, pattern flags other than ``i``, entailment, SPARQL,
and custom components. Patterns have Python's syntax, as in pySHACL.

The number of results is bounded (``check.MOST``), and so is the time: data may be untrusted, shapes are trusted. The
package depends on pyoxigraph and not on the gateway.
"""

from linked_fleet_shacl.check import CompiledGraph, CompiledShape
from linked_fleet_shacl.compiler import Compiler, compile_graph, compile_shape
from linked_fleet_shacl.data import Data
from linked_fleet_shacl.report import Statement, Violation, report
from linked_fleet_shacl.statements import Unsupported

__all__ = [
    "CompiledGraph",
    "CompiledShape",
    "Compiler",
    "Data",
    "Statement",
    "Unsupported",
    "Violation",
    "compile_graph",
    "compile_shape",
    "report",
]
