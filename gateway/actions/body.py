"""What an admitted body says, as typed values in SI units. The shape has judged it: what it demands is there."""

from collections.abc import Sequence

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from gateway.graph.build import Node
from gateway.graph.kinds import UNITS
from gateway.graph.vocab import VOM


class Body:
    """The triples of a body by subject and predicate, and the node at its root."""

    def __init__(self, triples: Sequence[Triple], root: Node) -> None:
        self.root = root
        self.triples = triples
        self._values: dict[tuple[Node, NamedNode], list[Node | Literal]] = {}
        for triple in dict.fromkeys(triples):
            self._values.setdefault((triple.subject, triple.predicate), []).append(triple.object)  # type: ignore[arg-type]

    def nodes(self, subject: Node, predicate: NamedNode) -> list[Node]:
        return [each for each in self._values.get((subject, predicate), ()) if isinstance(each, NamedNode | BlankNode)]

    def node(self, subject: Node, predicate: NamedNode) -> Node | None:
        return next(iter(self.nodes(subject, predicate)), None)

    def text(self, subject: Node, predicate: NamedNode) -> str | None:
        found = self._values.get((subject, predicate), ())
        return next((each.value for each in found if isinstance(each, Literal)), None)

    def number(self, subject: Node, predicate: NamedNode) -> float | None:
        text = self.text(subject, predicate)
        return None if text is None else float(text)

    def unit(self, subject: Node) -> float:
        """The size in SI of the unit that ``subject`` states; 1 where it states none."""
        unit = self.node(subject, VOM.unit)
        return UNITS[unit].si if isinstance(unit, NamedNode) else 1.0

    def quantity(self, subject: Node) -> float:
        """``vom:numericalValue`` in the SI unit."""
        value = self.number(subject, VOM.numericalValue)
        assert value is not None
        return value * self.unit(subject)
