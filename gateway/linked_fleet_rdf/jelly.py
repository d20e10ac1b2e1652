"""Jelly (https://w3id.org/jelly): triples as protobuf rows that state each IRI once.

``serialise`` imports this module with the first request for Jelly, because with protobuf it takes 7 MB.
"""

from collections.abc import Iterable
from io import BytesIO

from pyjelly import jelly
from pyjelly.options import LookupPreset
from pyjelly.serialize.encode import Rows, Slot, Statement, TermEncoder
from pyjelly.serialize.ioutils import write_delimited
from pyjelly.serialize.streams import SerializerOptions, TripleStream
from pyoxigraph import BlankNode, Literal, NamedNode, Triple

_OPTIONS = SerializerOptions(logical_type=jelly.LOGICAL_STREAM_TYPE_FLAT_TRIPLES)


class _Terms(TermEncoder):  # type: ignore[misc]  # pyjelly comes without types
    """Encodes the terms of pyoxigraph."""

    def encode_spo(self, term: object, slot: Slot, statement: Statement) -> Rows:
        if isinstance(term, NamedNode):
            return self.encode_iri(term.value, self.get_iri_field(statement, slot))
        if isinstance(term, BlankNode):
            self.set_bnode_field(statement, slot, term.value)
            return ()
        assert isinstance(term, Literal)
        # A literal with a language has an implied datatype.
        datatype = None if term.language else term.datatype.value
        literal = self.get_literal_field(statement, slot)
        return self.encode_literal(lex=term.value, language=term.language, datatype=datatype, literal=literal)


def write_jelly(triples: Iterable[Triple]) -> bytes:
    """Return a delimited stream of triples, as in files and over HTTP; blank nodes keep their labels."""
    stream = TripleStream(encoder=_Terms(LookupPreset()), options=_OPTIONS)
    written = BytesIO()
    stream.enroll()
    for triple in triples:
        if frame := stream.triple((triple.subject, triple.predicate, triple.object)):
            write_delimited(frame, written)
    if frame := stream.flow.to_stream_frame():
        write_delimited(frame, written)
    return written.getvalue()
