"""The IRIs that the compiler knows, each spelt once. A term that is not listed raises AttributeError."""

from pyoxigraph import BlankNode, Literal, NamedNode

Node = NamedNode | BlankNode
Term = NamedNode | BlankNode | Literal


class Namespace:
    """A closed set of terms under one IRI; attributes are NamedNodes."""

    def __init__(self, iri: str, terms: str) -> None:
        self.iri = iri
        self.terms = {term: NamedNode(iri + term) for term in terms.split()}

    def extended(self, terms: str) -> "Namespace":
        """Return the same namespace with further terms."""
        return Namespace(self.iri, " ".join((*self.terms, terms)))

    def __getattr__(self, term: str) -> NamedNode:
        try:
            found = self.terms[term.rstrip("_")]
        except KeyError:
            raise AttributeError(f"{self.iri} has no term {term!r} here") from None
        self.__dict__[term] = found  # so that this is called once for each term
        return found


RDF = Namespace("http://www.w3.org/1999/02/22-rdf-syntax-ns#", "type first rest nil langString")
RDFS = Namespace("http://www.w3.org/2000/01/rdf-schema#", "Class subClassOf")
XSD = Namespace(
    "http://www.w3.org/2001/XMLSchema#",
    "float double decimal integer int long short byte nonNegativeInteger positiveInteger nonPositiveInteger"
    " negativeInteger unsignedLong unsignedInt unsignedShort unsignedByte boolean string anyURI date dateTime",
)
SHACL = Namespace(
    "http://www.w3.org/ns/shacl#",
    # what the compiler understands
    "NodeShape PropertyShape path property node and or not xone minCount maxCount datatype nodeKind class in hasValue"
    " minInclusive minExclusive maxInclusive maxExclusive minLength maxLength pattern flags languageIn uniqueLang"
    " equals disjoint closed ignoredProperties"
    " qualifiedValueShape qualifiedMinCount qualifiedMaxCount qualifiedValueShapesDisjoint"
    " inversePath alternativePath zeroOrMorePath oneOrMorePath zeroOrOnePath"
    " name description order group defaultValue message severity deactivated parameter entailment"
    " target targetClass targetNode targetSubjectsOf targetObjectsOf"
    " IRI BlankNode Literal BlankNodeOrIRI BlankNodeOrLiteral IRIOrLiteral"
    # what a report says
    " Violation ValidationReport ValidationResult conforms result detail focusNode resultPath value"
    " sourceConstraintComponent sourceShape resultMessage resultSeverity"
    " MinCountConstraintComponent MaxCountConstraintComponent DatatypeConstraintComponent NodeKindConstraintComponent"
    " ClassConstraintComponent InConstraintComponent HasValueConstraintComponent MinInclusiveConstraintComponent"
    " MinExclusiveConstraintComponent MaxInclusiveConstraintComponent MaxExclusiveConstraintComponent"
    " MinLengthConstraintComponent MaxLengthConstraintComponent PatternConstraintComponent OrConstraintComponent"
    " AndConstraintComponent NotConstraintComponent XoneConstraintComponent NodeConstraintComponent"
    " QualifiedMinCountConstraintComponent QualifiedMaxCountConstraintComponent LanguageInConstraintComponent"
    " UniqueLangConstraintComponent EqualsConstraintComponent DisjointConstraintComponent ClosedConstraintComponent",
)
PREFIXES = {"rdf": RDF.iri, "rdfs": RDFS.iri, "xsd": XSD.iri, "sh": SHACL.iri}
