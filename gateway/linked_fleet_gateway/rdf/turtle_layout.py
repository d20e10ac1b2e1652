"""The layout of a document: top-level subjects, nested nodes and lists.

Turtle and JSON-LD share it. All walks are iterative, so that no graph, however deep or cyclic, overflows the stack.
"""

from collections.abc import Sequence

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_gateway.rdf.vocabulary import RDF

TYPE, FIRST, REST, NIL = RDF.type, RDF.first, RDF.rest, RDF.nil
MAX_NESTING = 32

Subject = NamedNode | BlankNode
Term = NamedNode | BlankNode | Literal
Properties = dict[NamedNode, list[Term]]


class Outline:
    """Subjects in order of appearance. Blank nodes with exactly one reference are nested at that reference."""

    def __init__(self, triples: Sequence[Triple]) -> None:
        self.properties: dict[Subject, Properties] = {}
        self.references: dict[BlankNode, list[tuple[Subject, NamedNode]]] = {}
        self._labels: dict[BlankNode, str] = {}
        for triple in dict.fromkeys(triples):
            self._add(triple)
        self._cells = self._list_cells()
        self._nested: set[BlankNode] = set()
        self.headings = self._arrange()

    def _add(self, triple: Triple) -> None:
        subject, predicate, value = triple.subject, triple.predicate, triple.object
        if isinstance(subject, Triple) or isinstance(value, Triple):
            raise TypeError("triple terms (RDF 1.2) have no place in our documents")
        self.properties.setdefault(subject, {}).setdefault(predicate, []).append(value)
        if isinstance(value, BlankNode):
            self.references.setdefault(value, []).append((subject, predicate))

    def label(self, node: BlankNode) -> str:
        """Return ``b0``, ``b1``, … in order of first use in the document."""
        return self._labels.setdefault(node, f"b{len(self._labels)}")

    def is_nested(self, node: Term) -> bool:
        return isinstance(node, BlankNode) and node in self._nested

    def is_anonymous(self, node: Subject) -> bool:
        """Return True if nothing refers to the node, so that it needs no label."""
        return isinstance(node, BlankNode) and node not in self.references

    def list_items(self, node: Term) -> list[Term] | None:
        """Return the items if the node is rdf:nil or the head of a well-formed nested list, else None."""
        if not (node == NIL or (self.is_nested(node) and node in self._cells)):
            return None
        items = []
        while isinstance(node, BlankNode):
            cell = self.properties[node]
            items.append(cell[FIRST][0])
            node = cell[REST][0]
        return items

    def _list_cells(self) -> set[Subject]:
        """Return cells from which rdf:rest leads to rdf:nil over cells with one reference and no other statements."""
        cells: set[Subject] = set()
        for subject, properties in self.properties.items():
            if properties.get(REST) != [NIL]:
                continue
            cell: Subject | None = subject
            while cell is not None and self._is_cell(cell):
                cells.add(cell)
                owner, predicate = self.references[cell][0]  # type: ignore[index]  # _is_cell: a blank node
                cell = owner if predicate == REST else None
        return cells

    def _is_cell(self, node: Subject) -> bool:
        properties = self.properties[node]
        return (
            isinstance(node, BlankNode)
            and len(self.references.get(node, ())) == 1
            and len(properties) == 2
            and len(properties.get(FIRST, ())) == 1
            and len(properties.get(REST, ())) == 1
        )

    def _arrange(self) -> list[Subject]:
        """Select nested nodes and return the top-level subjects.

        Cycles are cut at their first subject, depth at MAX_NESTING.
        """
        headings: dict[Subject, None] = {}
        for subject in self.properties:
            if not (isinstance(subject, BlankNode) and len(self.references.get(subject, ())) == 1):
                self._nest_below(subject, headings)
        for subject in self.properties:
            if subject not in headings and subject not in self._nested:
                self._nest_below(subject, headings)
        return [subject for subject in self.properties if subject in headings]

    def _nest_below(self, heading: Subject, headings: dict[Subject, None]) -> None:
        headings[heading] = None
        pending: list[tuple[Subject, int]] = [(heading, 0)]
        while pending:
            owner, depth = pending.pop()
            for predicate, values in self.properties.get(owner, {}).items():
                along_list = predicate == REST and owner in self._cells
                for value in values:
                    if not isinstance(value, BlankNode) or len(self.references[value]) > 1 or value in headings:
                        continue
                    below = depth if along_list else depth + 1
                    if below > MAX_NESTING:
                        headings[value] = None
                        below = 0
                    else:
                        self._nested.add(value)
                    pending.append((value, below))
