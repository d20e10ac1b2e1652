"""A page as a tree of elements, and in Python what its scripts read from forms (pages/scripts/src/form.js)."""

import json
from collections.abc import Iterator
from html.parser import HTMLParser

from rdflib import RDF, BNode, Graph, Literal, URIRef

from browser import LF

_VOID = {"area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source", "track", "wbr"}
_CONTROLS = ("input", "select", "textarea")


class Element:
    """``children`` are elements and texts."""

    def __init__(self, tag: str, attributes: dict[str, str], parent: "Element | None") -> None:
        self.tag, self.attributes, self.parent = tag, attributes, parent
        self.children: list[Element | str] = []

    def __getitem__(self, name: str) -> str:
        return self.attributes[name]

    def get(self, name: str, otherwise: str = "") -> str:
        return self.attributes.get(name, otherwise)

    @property
    def text(self) -> str:
        return "".join(each if isinstance(each, str) else each.text for each in self.children)

    def all(self, *tags: str, inert: bool = True) -> Iterator["Element"]:
        """Yield all elements below, in page order; with ``inert=False`` without the contents of templates."""
        for each in self.children:
            if isinstance(each, str):
                continue
            if not tags or each.tag in tags:
                yield each
            if inert or each.tag != "template":
                yield from each.all(*tags, inert=inert)

    def with_attribute(self, name: str) -> list["Element"]:
        return [each for each in self.all() if name in each.attributes]

    def by_id(self, id: str) -> "Element":
        (found,) = [each for each in self.all() if each.get("id") == id]
        return found


class _Builder(HTMLParser):
    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.root = self.here = Element("", {}, None)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        assert len(names) == len(set(names)), f"<{tag}> says an attribute twice: {names}"
        element = Element(tag, {name: value or "" for name, value in attrs}, self.here)
        self.here.children.append(element)
        if tag not in _VOID:
            self.here = element

    def handle_endtag(self, tag: str) -> None:
        assert self.here.tag == tag, f"</{tag}> ends <{self.here.tag}>"
        assert self.here.parent is not None
        self.here = self.here.parent

    def handle_data(self, data: str) -> None:
        self.here.children.append(data)


def parsed(page: bytes | str) -> Element:
    """Parse a page; AssertionError if elements are not closed in their order."""
    builder = _Builder()
    builder.feed(page.decode() if isinstance(page, bytes) else page)
    builder.close()
    assert builder.here is builder.root, f"<{builder.here.tag}> is not closed"
    return builder.root


# -- forms ----------------------------------------------------------------------------------------------------------


def filled(form: Element, everything: bool) -> Graph:
    """Return a body made by ``form``: of its required fields only, or with ``everything`` that is allowed."""
    graph = Graph()
    _node(graph, form, form["data-classes"], everything)
    return graph


def _node(graph: Graph, container: Element, classes: str, everything: bool) -> BNode:
    node = BNode()
    for name in classes.split():
        graph.add((node, RDF.type, URIRef(name)))
    parts = list(_parts(container, everything))
    chosen = {
        each["data-path"]: _chosen(each) for each in parts if each.tag == "select" or each.get("type") == "hidden"
    }
    for part in parts:
        if part.tag == "fieldset":
            if everything or int(part["data-min"]) > 0:
                below = _node(graph, part, part["data-classes"], everything)
                graph.add((node, URIRef(part["data-path"]), below))
        elif everything or needed(part) or part.get("type") == "hidden":
            graph.add((node, URIRef(part["data-path"]), _value(part, chosen)))
    return node


def needed(control: Element) -> bool:
    """Return True if a field is always in the body. A required select has a choice from the start."""
    if control.tag == "select":
        return all(option["value"] for option in control.all("option"))
    return "required" in control.attributes


def _parts(container: Element, everything: bool) -> Iterator[Element]:
    """Yield the fields and nested nodes of this node; of templates only those that are optional."""
    for each in container.children:
        if isinstance(each, str):
            continue
        if "data-path" in each.attributes:
            yield each
        elif each.tag != "template" or (
            everything
            and not any(isinstance(other, Element) and other.tag == "fieldset" for other in container.children)
        ):
            yield from _parts(each, everything)


def _chosen(control: Element) -> str:
    if control.tag != "select":
        return control["value"]
    options = [each for each in control.all("option") if each["value"]]
    if control["data-path"] == str(LF.ofJoint):
        return options[len(options) // 2]["value"]  # one that turns, on every robot: degrees come first among units
    return next((each["value"] for each in options if "selected" in each.attributes), options[0]["value"])


def _value(control: Element, chosen: dict[str, str]) -> URIRef | Literal:
    text = chosen.get(control["data-path"]) or control.get("value") or _typed(control, chosen)
    if control["data-kind"] == "iri":
        return URIRef(text)
    datatype = control["data-datatype"]
    if not datatype and control.get("type") == "number":
        datatype = "http://www.w3.org/2001/XMLSchema#decimal"
    return Literal(text, datatype=URIRef(datatype) if datatype else None)


def _typed(control: Element, chosen: dict[str, str]) -> str:
    if control.get("type") != "number":
        return "http://127.0.0.1:9/receiver" if control.get("type") == "url" else "text"
    limits = limits_of(control, chosen)
    low, high = limits.get("min", -1.0), limits.get("max", 1.0)
    return f"{(low + high) / 2:.5f}"


def limits_of(control: Element, chosen: dict[str, str]) -> dict[str, float]:
    """Return the limits of a number that apply to the present choices."""
    for each in json.loads(control.get("data-limits", "[]")):
        if all(chosen.get(path) in values for path, values in each.get("when", {}).items()):
            return {end: each[end] for end in ("min", "max") if end in each}
    return {}
