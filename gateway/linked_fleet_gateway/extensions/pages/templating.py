"""Templates whose texts are messages: each text that people read is translated, without a mark in the template.

A message is what stands between two tags or statements, with ``{1}``, ``{2}``, … for the expressions in it; and
the value of an attribute that people read. Texts inside expressions, such as arguments of macros, are marked by
``_("…")``. What ``code``, ``script`` and ``style`` contain is for programs.
"""

import html
import re
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import jinja2.ext

_READ = frozenset({"alt", "aria-description", "aria-label", "aria-roledescription", "label", "placeholder", "title"})
"""Attributes whose values people read."""
_JINJA = r"\{\{.*?\}\}|\{%.*?%\}|\{#.*?#\}"
_ATTRIBUTE = re.compile(rf'(?P<jinja>{_JINJA})|(?P<name>[\w:-]+)="(?P<value>(?:{_JINJA}|[^"])*)"', re.DOTALL)
_INSIDE = rf'(?:{_JINJA}|"(?:{_JINJA}|[^"])*"|[^>])*'
_PIECE = re.compile(
    r"(?P<expression>\{\{.*?\}\})"
    r"|(?P<statement>\{%.*?%\}|\{#.*?#\})"
    rf"|(?P<program><(?P<tag>code|script|style)\b{_INSIDE}>.*?</(?P=tag)>|<!.*?>)"
    rf"|(?P<markup></?[A-Za-z]{_INSIDE}>)"
    r"|(?P<text>(?:(?!\{[{%#]|</?[A-Za-z!]).)+)",
    re.DOTALL,
)
_MARKED = re.compile(r"""(?<![\w.])_\(\s*(?P<quote>["'])(?P<text>(?:(?!(?P=quote)).)+)(?P=quote)\s*[,)]""", re.DOTALL)
_IN_TAG = re.compile(r'\s*(?:disabled\s+)?[\w-]+="')
"""The beginning of attributes, which a macro or a branch has without their tag."""
_FOR_PROGRAMS = re.compile(r"\{%-?\s*block kind\b")
_FUNCTION = "_said"

Say = Callable[[str, list[str]], str]
"""Returns what a template has in the place of a message, whose values are expressions."""


def messages_of(source: str) -> set[str]:
    """Return the messages of a template."""
    found = set[str]()

    def collect(message: str, values: list[str]) -> str:
        found.add(message)
        return ""

    _rewritten(source, collect)
    return found | {each["text"] for each in _MARKED.finditer(source)}


def with_calls(source: str) -> str:
    """Return a template in which each message is a call that translates it."""
    return _rewritten(source, _call)


def _call(message: str, values: list[str]) -> str:
    quoted = message.replace("\\", "\\\\").replace('"', '\\"')
    return '{{ %s("%s", [%s]) }}' % (_FUNCTION, quoted, ", ".join(values))  # noqa: UP031 - braces


def _rewritten(source: str, say: Say) -> str:
    return "".join(_runs(source, say))


def _runs(source: str, say: Say) -> Iterator[str]:
    run, before = list[str](), ""
    for piece in _PIECE.finditer(source):
        if piece["text"] is not None or piece["expression"] is not None:
            run.append(piece[0])
            continue
        yield _run(run, say, before)
        run, before = [], piece[0]
        yield _tag(before, say) if piece["markup"] is not None else before
    yield _run(run, say, before)


def _tag(tag: str, say: Say) -> str:
    def attribute(found: re.Match[str]) -> str:
        if found["name"] not in _READ:
            return found[0]
        parts = re.split(r"(\{%.*?%\}|\{#.*?#\})", found["value"], flags=re.DOTALL)
        runs = [
            each if place % 2 else _run([one for one in re.split(r"(\{\{.*?\}\})", each) if one], say, "")
            for place, each in enumerate(parts)
        ]
        return f'{found["name"]}="{"".join(runs)}"'

    return _ATTRIBUTE.sub(attribute, tag)


def _run(pieces: list[str], say: Say, before: str) -> str:
    """Return a run of texts and expressions, as a message if people read a word in it; ``before`` it is a tag."""
    whole = "".join(pieces)
    if _IN_TAG.match(whole):
        return _tag(whole, say)
    if _FOR_PROGRAMS.match(before):
        return whole
    words = "".join(each for each in pieces if not each.startswith("{{"))
    if not any(each.isalpha() for each in html.unescape(words)):
        return whole
    values, parts = list[str](), list[str]()
    for each in pieces:
        if each.startswith("{{"):
            values.append(each[2:-2].strip("- \n"))
            parts.append(f"{{{len(values)}}}")
        else:
            parts.append(html.unescape(each))
    text = "".join(parts)
    start, end = text[: len(text) - len(text.lstrip())], text[len(text.rstrip()) :]
    inner = " ".join(text.split())
    lines = "\n" * (whole.count("\n") - start.count("\n") - end.count("\n"))
    call = say(inner, values)
    return start + (call[:-2] + lines + call[-2:] if lines and call else call) + end


def extension() -> "type[jinja2.ext.Extension]":
    """Return the extension of Jinja, which is loaded with the first page."""
    from jinja2.ext import Extension

    class Translated(Extension):
        def preprocess(self, source: str, name: str | None, filename: str | None = None) -> str:
            return with_calls(source)

    return Translated
