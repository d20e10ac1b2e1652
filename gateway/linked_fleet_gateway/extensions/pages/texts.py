"""Texts of pages: terms in words, numbers with few digits, units as written by people, times in UTC.

Sentences about tasks and requests are made from paths: "rotate right_s1" for an invocation of that action.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote
from zlib import crc32

from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.wire.keys import unescape
from linked_fleet_base.contributions import present
from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.extensions.pages import languages
from linked_fleet_gateway.extensions.pages.languages import say
from linked_fleet_rdf.shapes import VOCABULARY, added_files, load_turtle
from linked_fleet_rdf.vocabulary import LF, RDFS, ROS, XHV

if TYPE_CHECKING:
    from linked_fleet_client import quantity
else:
    quantity = LazyModule("linked_fleet_client.quantity")


_LARGE, _SMALL, _DECIMALS = 1e15, 1e-9, 4
_DECIMALS_IN = {"N m": 2, "N": 2, "rad/s": 3, "m/s": 3, "kg": 3, "s": 3}
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_CONVERTED = {"rad": (180 / math.pi, "°", 1), "m": (1000.0, " mm", 1)}
_DIMENSIONS = re.compile(r"(?<=[a-z])(\d+D)(?![a-z])")
_WORD = re.compile(r"\d+D(?![a-z])|[A-Z]+(?![a-z])|[A-Z]?[a-z0-9.]+|[^A-Za-z0-9\s_-]+")
_TERM = re.compile(
    r"\b(?:lf|hydra|maths|vom|sh|ros|hybrit|spatial|qudt|unit|xsd|prov|sosa|dcterms|ldp|rdfs?):[A-Za-z][\w-]*"
)
_COMMAND = re.compile(r"\bcommand [0-9a-f]{8}-[0-9a-f-]{27}")
_CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ufffe\uffff]")
_SPELT = {XHV.prev.value: "previous", ROS.preceedingLink.value: "preceding link"}
_LINK_MARK = "~link"
_ENGLISH = (None, languages.ENGLISH)


def clean(text: str) -> str:
    """Replace each character that HTML cannot contain."""
    return _CONTROL.sub("\ufffd", text)


def number(value: float, unit: str = "") -> str:
    """Format with the decimals that suit ``unit``, never in e-notation; scripts/src/format.js does the same."""
    size = abs(value)
    if not math.isfinite(value) or size >= _LARGE or 0 < size < _SMALL:
        return _power(value)
    decimals = _DECIMALS_IN.get(unit, _DECIMALS)
    if 0 < size < 10**-decimals and not unit:
        decimals = math.ceil(-math.log10(size)) + 1
    return _rounded(value, decimals)


def _power(value: float) -> str:
    """Format a very large or small number as a power of ten."""
    if not math.isfinite(value):
        return str(value)
    mantissa, _, exponent = f"{value:.2e}".partition("e")
    return f"{_trimmed(mantissa)}·10{str(int(exponent)).translate(_RAISED)}"


def converted(value: float, unit: str) -> str:
    """Convert rad to degrees and m to mm; empty for any other ``unit``."""
    if unit not in _CONVERTED or not math.isfinite(value):
        return ""
    scale, name, decimals = _CONVERTED[unit]
    return _rounded(value * scale, decimals) + name


def _rounded(value: float, decimals: int) -> str:
    text = _trimmed(f"{value:.{decimals}f}")
    return "0" if text == "-0" else text


def _trimmed(text: str) -> str:
    return languages.localized(text.rstrip("0").rstrip(".") if "." in text else text)


@lru_cache(maxsize=256)
def unit(iri: str) -> str:
    """Return the unit as people write it, ``N·m`` for ``unit:N-M``; empty for a dimensionless number."""
    return quantity.unit_label(iri).replace(" ", "·").replace("m2", "m²").replace("s2", "s²").replace("deg", "°")


def term_in_words(iri: str) -> str:
    """Return a term in words: ``lf:lastSeen`` is "last seen", and "zuletzt gesehen" in German."""
    return _term_in_words(iri, languages.language())


@lru_cache(maxsize=8192)
def _term_in_words(iri: str, language: str) -> str:
    labels, words = _labels(added_files(VOCABULARY)), english_words(iri)
    said = languages.translated(words)
    return clean(labels.get((iri, language)) or (labels.get((words, language), said) if said == words else said))


@lru_cache(maxsize=4096)
def english_words(iri: str) -> str:
    """Return a term in English words, which are also the message that is translated."""
    if said := _SPELT.get(iri) or _english_labels(added_files(VOCABULARY)).get(iri, ""):
        return said
    local = _DIMENSIONS.sub(r" \1", iri.rstrip("#/").replace("#", "/").rpartition("/")[2])
    parts = [each if each.isupper() and len(each) > 1 else each.lower() for each in _WORD.findall(local)]
    return clean(" ".join(parts)) or clean(iri)


@lru_cache(maxsize=1)
def _english_labels(added: tuple[Path, ...]) -> dict[str, str]:
    """Labels by term. ``added``: the files of extensions; other ones have other terms."""
    return {
        subject.value: _inside(said.value) for subject, said in _said_of_terms(RDFS.label) if said.language in _ENGLISH
    }


@lru_cache(maxsize=1)
def _comments(added: tuple[Path, ...]) -> dict[tuple[str, str], str]:
    """Comments by term of this project and language."""
    return {
        (subject.value, said.language or languages.ENGLISH): said.value
        for subject, said in _said_of_terms(RDFS.comment)
        if subject.value.startswith(LF.iri)
    }


def _said_of_terms(predicate: NamedNode) -> Iterator[tuple[NamedNode, Literal]]:
    for subject, triples in load_turtle(VOCABULARY).items():
        for each in triples:
            if isinstance(subject, NamedNode) and each.predicate == predicate and isinstance(each.object, Literal):
                yield subject, each.object


@lru_cache(maxsize=1)
def _labels(added: tuple[Path, ...]) -> dict[tuple[str, str], str]:
    """Labels in other languages than English, by term, and by its label in English, and language."""
    found = dict[tuple[str, str], str]()
    for subject, triples in load_turtle(VOCABULARY).items():
        labels = [each.object for each in triples if each.predicate == RDFS.label and isinstance(each.object, Literal)]
        english = next((_inside(each.value) for each in labels if each.language in _ENGLISH), "")
        for each in labels:
            if each.language is not None and each.language not in _ENGLISH and isinstance(subject, NamedNode):
                found[subject.value, each.language] = each.value
                found.setdefault((english, each.language), each.value)
    return found


def help_of(iri: str) -> str:
    """Return the comment of a term of this project in the language of the page, else in English; empty without one."""
    comments = _comments(added_files(VOCABULARY))
    english = languages.translated(comments.get((iri, languages.ENGLISH), ""))
    return sentence(comments.get((iri, languages.language())) or english)


def _inside(label: str) -> str:
    """Return a label as written inside a sentence."""
    return label[:1].lower() + label[1:] if label[1:2].islower() and label[:9] != "WebSocket" else label


def sentence(text: str) -> str:
    """Return a text for people: terms in it, such as ``lf:lastSeen``, become words, ids of commands are left out."""
    plain = _COMMAND.sub(languages.translated("another command"), languages.known(text))
    return _TERM.sub(_named_term, plain)


def _named_term(found: re.Match[str]) -> str:
    prefix, _, name = found[0].partition(":")
    return term_in_words(LF.iri + name if prefix == "lf" else name)


def local_name(iri: str) -> str:
    """Return the text of an IRI after the last ``#`` or ``/``."""
    return clean(iri.rstrip("#/").replace("#", "/").rpartition("/")[2] or iri)


def segment_name(segment: str, depth: int) -> str:
    """Return the name that a path segment stands for; ``depth`` is 0 directly below the root."""
    return _segment_name(segment, present().in_robot if depth else present().at_root)


@lru_cache(maxsize=4096)
def _segment_name(segment: str, reserved: frozenset[str]) -> str:
    try:
        return clean(unescape(segment.removesuffix(_LINK_MARK), reserved))
    except ValueError:
        return clean(segment)


def place(iri: str, root: str) -> str:
    """Return the name of a resource of this fleet from its path; ``root`` ends with a slash."""
    if "#" in iri:
        return term_in_words(iri)
    segments = [each for each in iri.removeprefix(root).split("/") if each]
    return step(segments, len(segments) - 1) if segments else say("fleet")


def step(segments: Sequence[str], depth: int) -> str:
    """Return the name of a path segment; an id is named by its container, such as "invocation"."""
    named = depth == 0 or (depth == 1 and segments[0] not in present().at_root)  # a robot, a joint or a link
    if not named and is_id(segments[depth]):
        return languages.translated(english_words(segments[depth - 1]).removesuffix("s"))
    if is_gateway_segment(segments, depth):
        return term_in_words(segments[depth])
    name = segment_name(segments[depth], depth)
    return languages.known(name) if segments[0] in present().at_root else name


def is_id(segment: str) -> bool:
    """Return True for a segment generated by the gateway, such as a UUID, which means nothing to people."""
    return len(segment) >= 8 and all(each in "0123456789abcdef-" for each in segment)


def is_gateway_segment(segments: Sequence[str], depth: int) -> bool:
    """Return True for a segment named by the gateway, such as that of an action, rather than by a robot."""
    reserved = present().in_robot if depth else present().at_root
    if segments[depth] in reserved or segments[depth - 1 : depth] == ["actions"]:
        return True
    # Below a joint or link all names are those of properties.
    return depth >= 2 and segments[0] not in present().at_root and segments[1] not in present().in_robot


def time_text(lexical: str) -> str:
    """Format an xsd:dateTime in UTC to the millisecond; other forms stay unchanged."""
    found = re.fullmatch(r"(\d{4}-\d\d-\d\d)T(\d\d:\d\d:\d\d)(\.\d+)?Z", lexical)
    return f"{found[1]} {found[2]}{(found[3] or '.000')[:4]} UTC" if found else clean(lexical)


def choice_label(iri: str) -> str:
    """Return the label of an IRI in a choice: the name of a part, or a term in words."""
    if "#" in iri:
        return term_in_words(iri)
    segment = iri.rstrip("/").rpartition("/")[2]
    return term_in_words(segment) if segment in present().in_robot else segment_name(segment, 1)


def id_prefix(iri: str) -> str:
    """Return a short prefix for ids, the same for the same IRI: one page may have several forms."""
    return f"f{crc32(iri.encode()):08x}"


def foreign_iri_text(iri: str) -> str:
    """Shorten an IRI of another host to its last segment and the host; an IRI that is not http(s) stays as it is."""
    if not iri.lower().startswith(("http://", "https://")):
        return clean(iri)
    host, _, path = iri.partition("://")[2].partition("/")
    name = path.rstrip("#/").replace("#", "/").rpartition("/")[2]
    return clean(say("{name} at {host}", name=name, host=host) if name else host)


_ACTIONS = "actions"
_ADDRESS = re.compile(r"https?://\S*[^\s.,;:]|(?<=\bof )/\S*")


def segments(iri: str, root: str) -> list[str]:
    """Return the path segments below ``root``, which ends with a slash; ``iri`` may also be a path."""
    path = iri.removeprefix(root) if iri.startswith(root) else iri
    return [unquote(each) for each in path.partition("?")[0].split("/") if each]


def task(iri: str, root: str) -> str:
    """Describe an action, an invocation or what is below it in words: what is done, and to which joint or member."""
    found = segments(iri, root)
    if _ACTIONS not in found[:-1]:
        return place(iri, root)
    at = found.index(_ACTIONS)
    part = step(found, 1) if at == 2 else ""
    return f"{term_in_words(found[at + 1])} {part}".rstrip()


def is_of_robot(iri: str, root: str) -> bool:
    """Return True for a resource of this fleet that is a robot or something of one."""
    found = segments(iri, root)
    return bool(found) and found[0] not in present().at_root


def thing(iri: str, root: str) -> str:
    """Describe a resource in words: "right_s1 of baxter", "placement of ur5", "the fleet"."""
    found = segments(iri, root)
    if not found:
        return say("the fleet")
    if found[0] in present().at_root:
        return " ".join(term_in_words(each) for each in found if not is_id(each))
    return _of_robot(found)


def _of_robot(found: Sequence[str]) -> str:
    robot, rest = segment_name(found[0], 0), [each for each in found[1:] if not is_id(each)]
    if _ACTIONS in rest[:2] and rest[-1] != _ACTIONS:
        at = rest.index(_ACTIONS)
        parts = [term_in_words(rest[at + 1]), *(segment_name(each, 1) for each in rest[:at])]
        return say("{part} of {whole}", part=" ".join(parts), whole=robot)
    names = [term_in_words(each) if n or each != each.lower() else segment_name(each, 1) for n, each in enumerate(rest)]
    said = robot
    for each in names:
        said = say("{part} of {whole}", part=each, whole=said)
    return said


def readable_title(text: str, root: str) -> str:
    """Return a title for people: addresses in it become names."""
    return _ADDRESS.sub(
        lambda found: thing(found[0], root) if _ours(found[0], root) else foreign_iri_text(found[0]), text
    )


def _ours(address: str, root: str) -> bool:
    return address.startswith((root, "/"))


# -- motions --------------------------------------------------------------------------------------------------------


def capitalized(text: str) -> str:
    return text[:1].upper() + text[1:]


def motion(iri: str, root: str, targets: Mapping[str, tuple[float, str]]) -> str:
    """Describe an invocation with its only target: "Rotate right_s1 to −100°". ``targets``: value and unit by joint."""
    said = capitalized(task(iri, root))
    if len(targets) > 1:
        return say("{what} ({count} joints)", what=said, count=len(targets))
    for joint, (value, unit) in targets.items():
        of = said if said.endswith(joint) else f"{said} {joint}"
        return say("{what} to {position}", what=of, position=position(value, unit))
    return said


def position(value: float, unit: str) -> str:
    """Format an angle in degrees, a length in millimetres; ``unit`` is the label of the unit in the data."""
    if not math.isfinite(value):
        return say("an unknown position")
    shown = converted(value, unit) or f"{number(value)} {unit}".rstrip()
    return shown.replace("-", "\N{MINUS SIGN}")
