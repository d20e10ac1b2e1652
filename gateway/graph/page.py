"""A plain HTML rendering of a graph: one table per subject, no script and no style, everything escaped."""

from collections.abc import Mapping, Sequence
from html import escape

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from gateway.graph.outline import Outline, Subject, Term
from gateway.graph.turtle import Names

_OTHERS = ("text/turtle", "application/ld+json", "application/n-triples", "application/rdf+xml")


def write(triples: Sequence[Triple], prefixes: Mapping[str, str], *, base: str, title: str) -> str:
    """The page; its alternate links name the media types that the same URI gives by ``Accept``."""
    page = _Page(Outline(triples), Names(prefixes))
    tables = "\n".join(page.table(subject) for subject in page.outline.properties)
    heading, here = escape(title or base), escape(base if _is_web(base) else "")
    links = "\n".join(f'<link rel="alternate" type="{kind}" href="{here}">' for kind in _OTHERS)
    others = ", ".join(f"<code>{kind}</code>" for kind in _OTHERS)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{heading}</title>\n{links}\n</head>\n"
        f"<body>\n<main>\n<h1>{heading}</h1>\n{tables}\n</main>\n"
        f"<footer><p>Also available, by <code>Accept</code>: {others}.</p></footer>\n</body>\n</html>\n"
    )


def _is_web(iri: str) -> bool:
    return iri.lower().startswith(("http://", "https://"))


class _Page:
    def __init__(self, outline: Outline, names: Names) -> None:
        self.outline = outline
        self.names = names

    def table(self, subject: Subject) -> str:
        rows = "\n".join(
            f'<tr><th scope="row">{self._term(predicate)}</th><td>{"<br>".join(map(self._term, values))}</td></tr>'
            for predicate, values in self.outline.properties[subject].items()
        )
        anchor = f' id="{self.outline.label(subject)}"' if isinstance(subject, BlankNode) else ""
        return f"<table{anchor}>\n<caption>{self._term(subject)}</caption>\n{rows}\n</table>"

    def _term(self, term: Term) -> str:
        if isinstance(term, NamedNode):
            return self._iri(term.value)
        if isinstance(term, Literal):
            return self._literal(term)
        label = self.outline.label(term)
        return f'<a href="#{label}">_:{label}</a>' if term in self.outline.properties else f"_:{label}"

    def _iri(self, iri: str) -> str:
        text = escape(self.names.prefixed(iri) or iri)
        return f'<a href="{escape(iri)}">{text}</a>' if _is_web(iri) else f"<code>{text}</code>"

    def _literal(self, literal: Literal) -> str:
        language = f' lang="{escape(literal.language)}"' if literal.language else ""
        datatype = escape(self.names.prefixed(literal.datatype.value) or literal.datatype.value)
        return f'<data value="{escape(literal.value)}" title="{datatype}"{language}>{escape(literal.value)}</data>'
