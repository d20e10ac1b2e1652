"""Forms of descriptions: those of one form differ in names and values alone, and share a template.

The form of a description is all that decides its text but for the texts themselves: which statements there are, in
which order, about which nodes. Names are the path segments of IRIs of the fleet, values the literals. The second
description of a form is written with markers in place of names and values, and gives the template; that and the
following ones are filled in.

A description with names that some syntax would write in another way is written as usual, and so is the first one of
each form, because many forms occur once.
"""

import re
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_rdf import vocabulary
from linked_fleet_rdf.graph import Graph, Node, Term
from linked_fleet_rdf.serialise import N_TRIPLES, TEXT_TYPES, n_triples, render
from linked_fleet_rdf.templates import Document, Key, Markers, Template, TemplateCache, is_replaceable
from linked_fleet_rdf.turtle import TYPE
from linked_fleet_shacl.terms import Namespace

MAX_TEMPLATES = 2048
MAX_CHARACTERS = 8 * 1024 * 1024
"""Default limits of the templates of all forms."""
MAX_FORMS = 16_384
_ROOT = re.compile(r"(https?://[^/?#]+)(/[^?#]*)")
# No syntax escapes these characters, and no segment looks like a prefix or a relative reference.
_PATH = re.compile(r"(?:/[A-Za-z0-9_~][A-Za-z0-9_~-]*)*/?(?:#[A-Za-z0-9_~][A-Za-z0-9_~-]*)?", re.ASCII)
_SEGMENT = re.compile(r"[^/#]+")
_TYPE = TYPE.value
_Code = str | int | tuple[int, ...]
"""A text for what is the same in all documents of a form, a number for a blank node, numbers for a path."""


class _Form(NamedTuple):
    """Codes of the terms of a description, and its values: literals first, then path segments."""

    key: Key
    literals: list[str]
    """Texts of literals, and paths of IRIs outside the folder of the document, in the order of the statements."""
    segments: list[str]


class FormTemplates:
    """Templates by form, media type and root of the IRIs, of ``max_characters`` in all. Safe for threads."""

    def __init__(self, max_characters: int = MAX_CHARACTERS) -> None:
        self._templates = TemplateCache(MAX_TEMPLATES, max_characters)
        self._met: set[int] = set()

    def __len__(self) -> int:
        return len(self._templates)

    def render(self, graph: Graph, media_type: str, prefixes: Mapping[str, str], *, base: str) -> bytes:
        """Return the document as ``serialise.render`` does, with the same bytes. Raises WriteError as that does."""
        return self.document(graph, media_type, prefixes, base=base).content

    def document(self, graph: Graph, media_type: str, prefixes: Mapping[str, str], *, base: str) -> Document:
        """Return the same with its template. Raises WriteError."""
        form = _form_of(graph, base, prefixes) if media_type in TEXT_TYPES else None
        if form is None:
            return Document(write_graph(graph, media_type, prefixes, base=base))
        key = (media_type, *form.key)
        template = self._templates.get(key)
        if template is None:
            if self._is_new(key):
                return Document(write_graph(graph, media_type, prefixes, base=base))
            template = _compile(graph, form, media_type, prefixes, base)
            self._templates.keep(key, template)
        values = form.literals + form.segments
        return Document(template.fill(values), template, values)

    def _is_new(self, key: Key) -> bool:
        """Return True the first time a form is met."""
        met = hash(key)
        if met in self._met:
            return False
        if len(self._met) >= MAX_FORMS:
            self._met.clear()
        self._met.add(met)
        return True


class _NotReplaceable(Exception):  # noqa: N818 -- a state, not a defect
    """A name that some syntax would write in another way."""


class _Codes:
    """Assigns each term of one description a code; equal codes are written alike but for names and values."""

    def __init__(self, root: str, folder: str) -> None:
        self._root, self._folder = root, folder
        self._segments: dict[str, int] = {}
        self._blanks: dict[str, int] = {}
        self._paths: dict[str, tuple[int, ...]] = {}
        self.literals: list[str] = []

    @property
    def segments(self) -> list[str]:
        return list(self._segments)

    def subject(self, node: Node) -> _Code:
        """Return the code of a subject; that of a blank node is a number. Raises _NotReplaceable."""
        if isinstance(node, BlankNode):
            return self._blank(node)
        iri = node.value
        return self.path(iri[len(self._root) :]) if iri.startswith(self._root) else iri

    def fixed(self, node: NamedNode) -> str:
        """Return the code of a predicate or class.

        Raises _NotReplaceable for those of the fleet itself, because RDF/XML cannot write each.
        """
        iri = node.value
        if iri.startswith(self._root):
            raise _NotReplaceable
        return iri

    def object(self, node: Node, known: dict[int, _Code]) -> _Code:
        """Return the code of a node that is an object, and remember it if it is always the same.

        An IRI outside the folder of the document is written in full, so that one value takes its place, whichever nodes
        it names.
        """
        if isinstance(node, BlankNode):
            return known.setdefault(id(node), self._blank(node))
        iri = node.value
        if not iri.startswith(self._root):
            return known.setdefault(id(node), iri)
        path = iri[len(self._root) :]
        if not _is_outside(path, self._folder):
            return known.setdefault(id(node), self.path(path))
        if not _PATH.fullmatch(path):
            raise _NotReplaceable
        self.literals.append(path[1:])
        return "\3"

    def _blank(self, node: BlankNode) -> int:
        # Labels are not part of a text.
        return self._blanks.setdefault(node.value, len(self._blanks))

    def path(self, path: str) -> tuple[int, ...]:
        """Return the numbers of the segments of a path, and of its delimiters. Raises _NotReplaceable."""
        found = self._paths.get(path)
        if found is None:
            if not _PATH.fullmatch(path):
                raise _NotReplaceable
            numbers, parts = self._segments, path.replace("#", "/#/").split("/")
            found = self._paths[path] = tuple([numbers.setdefault(part, len(numbers)) for part in parts])
        return found

    def literal(self, literal: Literal) -> str:
        """Return the code of a literal. The text becomes one of ``literals``, or a part of the code if it is fixed."""
        text, datatype = literal.value, literal.datatype.value
        language = literal.language
        if language is None and is_replaceable(text, datatype):
            self.literals.append(text)
            return f"\1{datatype}"
        return f"\2{len(text)} {text} {datatype} {language}"


def _folder(path: str) -> str:
    return path[: path.rfind("/") + 1]


def _is_outside(path: str, folder: str) -> bool:
    return path.startswith("/") and not path.startswith(folder)


def _form_of(graph: Graph, base: str, prefixes: Mapping[str, str]) -> _Form | None:
    """Return the form of a description; None if a name in it cannot be replaced."""
    split = _ROOT.fullmatch(base)
    if split is None or _is_abbreviated(split[1], tuple(prefixes.values())):
        return None
    try:
        return _coded(graph, split[1], split[2])
    except _NotReplaceable:
        return None


@lru_cache(maxsize=64)
def _is_abbreviated(root: str, namespaces: tuple[str, ...]) -> bool:
    """Return True if a prefix abbreviates IRIs of the fleet."""
    return any(namespace.startswith(root) for namespace in namespaces)


@lru_cache(maxsize=64)
def _terms_elsewhere(root: str) -> Mapping[int, str]:
    """Return the IRIs of all terms of the vocabulary that are not below ``root``, by identity.

    The vocabulary holds its terms for ever, so that none of these identities becomes that of another object.
    """
    spaces = [each for each in vars(vocabulary).values() if isinstance(each, Namespace)]
    return {
        id(term): term.value for space in spaces for term in space.terms.values() if not term.value.startswith(root)
    }


def _coded(graph: Graph, root: str, path: str) -> _Form:
    codes = _Codes(root, _folder(path))
    found: list[object] = [root, codes.path(path)]
    # Terms by identity, because the graph holds them and often has the same object. Objects are apart: a value takes
    # the place of an IRI outside the folder that is an object, but not of the same IRI that is a subject.
    known: dict[int, _Code] = {}
    objects: dict[int, _Code] = {}
    terms = _terms_elsewhere(root)
    for subject, predicate, value in graph.statements:
        code = known.get(id(subject))
        if code is None:
            code = known[id(subject)] = codes.subject(subject)
        relation = terms.get(id(predicate))
        if relation is None:
            relation = codes.fixed(predicate)
        if type(value) is Literal:
            about: _Code | None = codes.literal(value)
        else:
            about = terms.get(id(value))
            if about is None:
                if relation == _TYPE and type(value) is NamedNode:
                    about = codes.fixed(value)
                else:
                    about = objects.get(id(value))
                    if about is None:
                        about = codes.object(value, objects)
        found += (code, relation, about)
    return _Form(tuple(found), codes.literals, codes.segments)


def write_graph(graph: Graph, media_type: str, prefixes: Mapping[str, str], *, base: str) -> bytes:
    """Return the document as ``serialise.render`` does, without a template. Raises WriteError."""
    if media_type == N_TRIPLES:
        return n_triples(graph.statements)
    return render(graph.triples, media_type, prefixes, base=base)


def _compile(graph: Graph, form: _Form, media_type: str, prefixes: Mapping[str, str], base: str) -> Template:
    """Write the description with markers, and find their places."""
    split = _ROOT.fullmatch(base)
    assert split is not None
    marks = _MarksOfForm(form, split[1], _folder(split[2]))
    marked = Graph()
    marked.extend(
        (marks.node(subject), predicate, marks.object(value)) for subject, predicate, value in graph.statements
    )
    document = write_graph(marked, media_type, prefixes, base=split[1] + marks.path(split[2]))
    return marks.template(document.decode())


class _MarksOfForm(Markers):
    """Markers for the values of a form, by their indices in it."""

    def __init__(self, form: _Form, root: str, folder: str) -> None:
        super().__init__()
        self._root, self._folder = root, folder
        self._literals = 0
        self._segments = {text: len(form.literals) + index for index, text in enumerate(form.segments)}

    def object(self, term: Term) -> Term:
        if isinstance(term, Literal):
            return self._literal(term)
        if isinstance(term, NamedNode) and term.value.startswith(self._root):
            path = term.value[len(self._root) :]
            if _is_outside(path, self._folder):
                return NamedNode(f"{self._root}/{self.text(self._next())}")
        return self.node(term)

    def node(self, node: Node) -> Node:
        if isinstance(node, NamedNode) and node.value.startswith(self._root):
            return NamedNode(self._root + self.path(node.value[len(self._root) :]))
        return node

    def path(self, path: str) -> str:
        return _SEGMENT.sub(lambda match: self.text(self._segments[match[0]]), path)

    def _literal(self, literal: Literal) -> Literal:
        if literal.language is not None or not is_replaceable(literal.value, literal.datatype.value):
            return literal
        return self.literal(self._next(), literal.datatype)

    def _next(self) -> int:
        index, self._literals = self._literals, self._literals + 1
        return index


_templates = FormTemplates()


def render_graph(graph: Graph, media_type: str, prefixes: Mapping[str, str], *, base: str) -> Document:
    """Return the document by the templates of this process, as ``FormTemplates.document``."""
    return _templates.document(graph, media_type, prefixes, base=base)
