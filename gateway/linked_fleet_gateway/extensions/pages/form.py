"""Forms generated from SHACL shapes, from which `scripts/src/form.js` composes a body."""

import json
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import rdflib
from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, parse, serialize
from rdflib.term import Node, URIRef

from linked_fleet_base.contributions import present
from linked_fleet_client.form import all_fields, choices
from linked_fleet_client.quantity import INTEGERS, UNIT_PATHS, UNITS
from linked_fleet_client.shape import Bound, Field, Shape, conjunction, read_shape
from linked_fleet_client.vocabulary import SH
from linked_fleet_gateway.extensions.pages import languages, texts
from linked_fleet_gateway.extensions.pages.form_parts import Form, Group, Leaf
from linked_fleet_gateway.extensions.pages.languages import say
from linked_fleet_gateway.extensions.pages.values import Facts
from linked_fleet_gateway.faces import Form as JsonForm
from linked_fleet_gateway.faces import Right, action_definitions, describe_request_shape, form_in
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.shapes import BLUEPRINTS, add_closure, load_turtle
from linked_fleet_rdf.turtle import Term
from linked_fleet_rdf.vocabulary import DCTERMS, HTTP, HYBRIT, LF, NUMERIC, QUDT, RDF, VOM, XSD

_RESET = LF.extended("ResetProtectiveStop").ResetProtectiveStop
_NUMBERS = frozenset(URIRef(each.value) for each in NUMERIC)
_EXACT = frozenset({URIRef(XSD.decimal.value), URIRef(XSD.double.value)})
_TEXT, _ADDRESS, _BOOLEAN = (URIRef(each.value) for each in (XSD.string, XSD.anyURI, XSD.boolean))
_MANY = 256
_EDITORS = {"application/sparql-query": "sparql", "text/turtle": "turtle"}
_RDF_TYPE = rdflib.RDF.type


# -- which forms there are ------------------------------------------------------------------------------------------


def form_of_action(facts: Facts, iri: NamedNode) -> Form:
    """Return the form of an action; it has no fields if the action consumes nothing."""
    methods = {each.value.rpartition("#")[2] for each in facts.all(iri, HYBRIT.binding, HTTP.mthd)}
    name = facts.text(iri, DCTERMS.identifier) or texts.place(iri.value, facts.root)
    rehearses = facts.one(iri, LF.dryRun) == Literal("true", datatype=XSD.boolean)
    consumed = facts.one(iri, HYBRIT.consumes)
    classes, fields = ("", ()) if consumed is None else _fields(_written(facts), str(consumed))
    # PUT first, because it can be repeated safely.
    types = set(facts.all(iri, RDF.type))
    right = Right.RESET if _RESET in types else _right(types)
    return _form(
        iri.value,
        sorted(methods, reverse=True) or ["POST"],
        texts.term_in_words(name),
        classes,
        fields,
        right,
        rehearses,
    )


def _right(types: Set[Term]) -> Right:
    """Return the right that invoking an action of these types needs."""
    return next((each.right for each in action_definitions() if each.iri in types), Right.ACT)


def form_of_setting(facts: Facts, iri: NamedNode) -> Form | None:
    """Return the form of a setting; None if another document describes the accepted body."""
    consumed = facts.one(iri, HYBRIT.consumes)
    if not isinstance(consumed, NamedNode) or consumed not in load_turtle(BLUEPRINTS):
        return None
    classes, fields = _fields(_blueprint(consumed), str(consumed))
    value = facts.one(iri, LF.value)
    number = value if isinstance(value, Literal) or value is None else facts.one(value, VOM.numericalValue)
    present = {each: number.value for each in (LF.value.value, VOM.numericalValue.value) if isinstance(number, Literal)}
    return _form(iri.value, ["PUT"], say("set"), classes, _prefilled(_filled(fields, facts, iri), present), Right.ADMIN)


def form_of_shape(
    shape: NamedNode,
    action: str,
    method: str,
    name: str,
    facts: Facts,
    subject: Term,
    right: Right,
    file: Path | None = None,
) -> Form:
    """Return the form of a shape in ``file``, or of a blueprint, filled with what ``facts`` say about ``subject``.

    ``right`` is that which its request needs.
    """
    classes, fields = _fields(_blueprint(shape, file), str(shape))
    return _form(action, [method], name, classes, _filled(fields, facts, subject), right)


def form_of_subscription(container: str, owner: str) -> Form:
    """Return the form that creates a subscription; ``owner`` is the IRI of the thing to which the container belongs."""
    classes, fields = _fields(_request_shape(), str(LF.SubscriptionShape))
    shown = _prefilled(fields, {HYBRIT.onResource.value: owner})
    return Form(container, texts.id_prefix(container), "POST", classes, say("subscribe"), shown, (), Right.SUBSCRIBE)


def _form(
    action: str,
    methods: Sequence[str],
    name: str,
    classes: str,
    fields: Iterable[Leaf | Group],
    right: Right,
    rehearses: bool = False,
) -> Form:
    fields = list(fields)
    needed = [each for each in fields if each.required or (isinstance(each, Leaf) and each.input == "hidden")]
    further = [each for each in fields if each not in needed]
    return Form(action, texts.id_prefix(action), " ".join(methods), classes, name, needed, further, right, rehearses)


def _prefilled(fields: Iterable[Leaf | Group], values: Mapping[str, str]) -> list[Leaf | Group]:
    return [_with_value(each, values) if isinstance(each, Leaf) else _with_values(each, values) for each in fields]


def _filled(fields: Iterable[Leaf | Group], facts: Facts, subject: Term) -> list[Leaf | Group]:
    """Return the fields filled with the facts about ``subject`` and the nodes below it."""
    return [_filled_field(each, facts.all(subject, NamedNode(each.path)), facts) for each in fields]


def _filled_field(own: Leaf | Group, said: Sequence[Term], facts: Facts) -> Leaf | Group:
    if isinstance(own, Leaf):
        offered = {value for value, _ in own.options}
        known = [each.value for each in said if isinstance(each, Literal | NamedNode) and each != LF.unknown]
        fitting = [each for each in known if each in offered or not offered]
        if not fitting or own.input == "hidden":
            return own
        return replace(own, value=fitting[0], further=fitting[1:] if own.most > 1 else ())
    if not said or not isinstance(said[0], BlankNode):
        return own
    fields = _filled(own.fields, facts, said[0])
    return replace(own, fields=fields, filled=fields != list(own.fields))


def _with_value(leaf: Leaf, values: Mapping[str, str]) -> Leaf:
    return leaf if leaf.input == "hidden" or leaf.path not in values else replace(leaf, value=values[leaf.path])


def _with_values(group: Group, values: Mapping[str, str]) -> Group:
    return replace(group, fields=_prefilled(group.fields, values))


# -- shapes ---------------------------------------------------------------------------------------------------------


def _written(facts: Facts) -> bytes:
    return serialize(facts.triples, format=RdfFormat.N_TRIPLES) or b""


def _blueprint(shape: NamedNode, file: Path | None = None) -> bytes:
    return present().derived(("blueprint in N-Triples", shape, file), lambda: _written_blueprint(shape, file))


def _written_blueprint(shape: NamedNode, file: Path | None) -> bytes:
    graph = Graph()
    add_closure(graph, shape, file)
    return serialize(graph.triples, format=RdfFormat.N_TRIPLES) or b""


@lru_cache(maxsize=1)
def _request_shape() -> bytes:
    graph = Graph()
    describe_request_shape(graph)
    return serialize(graph.triples, format=RdfFormat.N_TRIPLES) or b""


def _fields(described: bytes, node: str) -> tuple[str, tuple[Leaf | Group, ...]]:
    """Return the classes and fields of a shape in N-Triples, in the language of the page."""
    return _read_fields(described, node, languages.language())


@lru_cache(maxsize=128)
def _read_fields(described: bytes, node: str, language: str) -> tuple[str, tuple[Leaf | Group, ...]]:
    """Return the classes and fields of a shape in N-Triples.

    Cached, because reading takes long and shapes rarely change.
    """
    graph, triples = rdflib.Graph(), list(parse(described, format=RdfFormat.N_TRIPLES))
    found: Node = rdflib.BNode()
    for triple in triples:
        terms = [_term(each) for each in (triple.subject, triple.predicate, triple.object)]
        graph.add((terms[0], terms[1], terms[2]))
        found = terms[2] if str(triple.object) == node else terms[0] if str(triple.subject) == node else found
    shape = read_shape(graph, found)
    known = form_in(triples, NamedNode(found) if isinstance(found, URIRef) else BlankNode(str(found)))
    return _classes(shape), tuple(_with_members([_field(each, shape) for each in _asked(shape)], known))


def _with_members(fields: Iterable[Leaf | Group], known: JsonForm, above: tuple[str, ...] = ()) -> list[Leaf | Group]:
    """Return the fields with their names in the JSON form, which has no object for a group without a name."""
    members = {tuple(step.value for step in each.path): each for each in known.fields}
    found = list[Leaf | Group]()
    for each in fields:
        path = (*above, each.path)
        own = members.get(path)
        if isinstance(each, Leaf):
            found.append(each if own is None else replace(each, member=own.name))
        elif own is None or own.value.form is None:
            found.append(replace(each, fields=_with_members(each.fields, known, path)))
        else:
            found.append(replace(each, member=own.name, fields=_with_members(each.fields, own.value.form)))
    return found


def _term(term: Term) -> Node:
    """Return the term in rdflib; blank nodes keep their labels, so that an order that depends on them is stable."""
    if isinstance(term, NamedNode):
        return URIRef(term.value)
    if isinstance(term, BlankNode):
        return rdflib.BNode(term.value)
    if term.language:
        return rdflib.Literal(term.value, lang=term.language)
    return rdflib.Literal(term.value, datatype=URIRef(term.datatype.value), normalize=False)


def _classes(shape: Shape) -> str:
    return " ".join(shape.classes)


def _asked(shape: Shape) -> list[Field]:
    """Return the fields without the type, which the classes imply unless it must be chosen."""
    fields = _without_repeated_unit(all_fields(shape))
    return [each for each in fields if each.path != _RDF_TYPE or _is_choice(each)]


def _without_repeated_unit(fields: Iterable[Field]) -> list[Field]:
    """Return the fields without the unit of QUDT beside the other unit, which says the same."""
    fields = list(fields)
    repeated = QUDT.unit.value if any(str(each.path) == VOM.unit.value for each in fields) else ""
    return [each for each in fields if str(each.path) != repeated]


def _is_choice(own: Field) -> bool:
    return own.min_count > 0 and len(own.allowed or ()) > 1


def _branches(shape: Shape) -> list[Shape]:
    return [branch for group in shape.alternatives for branch in group]


def _field(own: Field, shape: Shape) -> Leaf | Group:
    branches = _branches(shape)
    there = [found.shape for branch in branches if (found := branch.field(own.path)) and found.shape.fields]
    nested = conjunction([own.shape, *there])
    most = _MANY if own.max_count is None else own.max_count
    name, hint = texts.term_in_words(own.name), texts.sentence(texts.clean(own.description))
    inner = _asked(nested)
    if inner:
        fields = [_field(each, nested) for each in inner]
        return Group(str(own.path), name, hint, _classes(nested), own.min_count, most, fields)
    return _leaf(own, branches, name, hint, most)


def _leaf(own: Field, branches: Sequence[Shape], name: str, hint: str, most: int) -> Leaf:
    path, required, value = str(own.path), own.min_count > 0, "" if own.default is None else str(own.default)
    offered = choices(own, branches)
    if offered is not None:
        return _choice(own, list(offered), name, hint, value, most)
    if own.format in _EDITORS:
        return Leaf(path, name, hint, required, "textarea", False, "", value, editor=_EDITORS[own.format])
    kinds = [own.shape, *_branches(own.shape)]
    datatypes = next((each.datatypes for each in kinds if each.datatypes), ())
    limits = _limits(own, branches)
    if limits or not _NUMBERS.isdisjoint(datatypes):
        # The scripts choose between decimal and double by what was typed.
        datatype = "" if not datatypes or _EXACT.issubset(datatypes) else str(datatypes[0])
        step = "1" if datatypes and INTEGERS.issuperset(datatypes) else "any"
        return Leaf(path, name, hint, required, "number", False, datatype, value, (), limits, step, most)
    if any(each.node_kind or each.classes for each in kinds) and not datatypes:
        variable = own.shape.node_kind == SH.BlankNodeOrIRI
        return Leaf(
            path, name, hint, required, "text" if variable else "url", True, "", value, most=most, variable=variable
        )
    if _BOOLEAN in datatypes:
        options = [("true", say("yes")), ("false", say("no"))]
        return Leaf(path, name, hint, required, "select", False, str(_BOOLEAN), value, options, most=most)
    datatype = str(datatypes[0]) if datatypes and datatypes[0] != _TEXT else ""
    kind = "url" if _ADDRESS in datatypes else "text"
    return Leaf(path, name, hint, required, kind, False, datatype, value, most=most)


def _choice(own: Field, offered: list[Node], name: str, hint: str, value: str, most: int) -> Leaf:
    offered = _each_unit_once(offered)
    iri = all(isinstance(each, URIRef) for each in offered)
    datatype = getattr(offered[0], "datatype", None) if offered else None
    options = [(str(each), _option(each)) for each in offered]
    fixed = own.fixed or (len(offered) == 1 and (own.min_count > 0 or own.path in UNIT_PATHS))
    return Leaf(
        path=str(own.path),
        label=name,
        hint=hint,
        required=own.min_count > 0,
        input="hidden" if fixed else "select",
        iri=iri,
        datatype="" if datatype in (None, _TEXT) else str(datatype),
        value=options[0][0] if fixed else value,
        options=options,
        most=1 if fixed else most,
    )


def _each_unit_once(offered: Sequence[Node]) -> list[Node]:
    """Keep one of the IRIs of each unit, degrees first, since people think in degrees."""
    once: dict[object, Node] = {}
    for each in offered:
        once.setdefault(UNITS.get(str(each), each), each)
    return sorted(once.values(), key=lambda each: not (_is_unit(each) and texts.unit(str(each)).startswith("°")))


def _is_unit(term: Node) -> bool:
    return str(term) in UNITS


def _option(term: Node) -> str:
    if not isinstance(term, URIRef):
        return texts.clean(str(term))
    return texts.unit(str(term)) or say("no unit") if _is_unit(term) else texts.choice_label(str(term))


def _limits(own: Field, branches: Sequence[Shape]) -> str:
    """Return JSON: the ranges of a number, narrowest first, each with the values of other fields that select it."""
    ranges = [_range(own, branch) for branch in (*(each for each in branches if each.field(own.path)), Shape())]
    bounded = [each for each in ranges if "min" in each or "max" in each]
    return json.dumps(bounded, separators=(",", ":")) if bounded else ""


def _range(own: Field, branch: Shape) -> dict[str, object]:
    """Return the range in one branch of the alternatives; without a branch, the range that always holds."""
    there = branch.field(own.path)
    both = conjunction([own.shape, there.shape]) if there else own.shape
    others = {
        str(each.path): [str(term) for term in each.allowed]
        for each in _without_repeated_unit(branch.fields)
        if each.path != own.path and each.allowed
    }
    ends: dict[str, Bound | None] = {"min": both.lower, "max": both.upper}
    open_ends = [name for name, bound in ends.items() if bound and not bound.inclusive]
    return {
        **({"when": others} if others else {}),
        **{name: bound.value for name, bound in ends.items() if bound},
        **({"exclusive": open_ends} if open_ends else {}),
    }
