"""Bodies of permitted size that cost as much time as possible, for every endpoint with a body and in every syntax.

A *family* repeats one construct until the body is full. None may block the event loop.
"""

import base64
import json
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from random import Random
from typing import Any

from fuzzing.good import TURTLE_PREFIXES
from linked_fleet_gateway.extensions.sessions.login import MAX_BODY_BYTES as MAX_LOGIN_BYTES
from linked_fleet_gateway.extensions.world.extension import MAX_BODY_BYTES as MAX_OBJECT_BYTES
from linked_fleet_gateway.extensions.world.extension import MAX_TRIPLES as MAX_OBJECT_TRIPLES
from linked_fleet_gateway.http.body import MAX_BODY_BYTES
from linked_fleet_gateway.http.invoke import MAX_BODY_BYTES as MAX_INPUT_BYTES
from linked_fleet_gateway.http.invoke import MAX_TRIPLES as MAX_INPUT_TRIPLES
from linked_fleet_gateway.resources.annotations import MAX_ANNOTATION_TRIPLES
from linked_fleet_rdf.parsing import MAX_TRIPLES
from linked_fleet_rdf.sparql_tokens import MAX_QUERY_BYTES

TURTLE, TRIPLES, XML = "text/turtle", "application/n-triples", "application/rdf+xml"
JSON_LD, JSON, QUERY, FORM = (
    "application/ld+json", "application/json", "application/sparql-query", "application/x-www-form-urlencoded",
)  # fmt: skip
ACCEPTED = ("application/problem+json", TURTLE, "text/html", XML, JSON_LD, TRIPLES, "application/x-jelly-rdf")
_RDF = '<r:RDF xmlns:r="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns="u:">'
_POINT = "maths:x 5 ; maths:y 5 ; maths:z 5 ; vom:unit unit:M"
_PAN = "[ lf:ofJoint </arm/pan> ; vom:numericalValue 0.1 ; vom:unit unit:RAD ]"
_SLIDE = "[ lf:ofJoint </arm/slide> ; vom:numericalValue 0.2 ; vom:unit unit:M ]"


@dataclass(frozen=True)
class Endpoint:
    """``bytes_``: size limit of the body; ``triples``: limit of triples."""

    method: str
    path: str
    bytes_: int = MAX_BODY_BYTES
    triples: int = MAX_TRIPLES

    @property
    def families(self) -> str:
        """Return the name under which its own families are stored."""
        return "update" if self.method == "PATCH" else self.path.rpartition("/")[2]


SUBSCRIPTION = "{subscription}"
"""Placeholder in a path for the id of a subscription of ``/arm/pan``, which the sender of the attack creates."""
ENDPOINTS: tuple[Endpoint, ...] = (
    Endpoint("PUT", "/arm/pan/actions/rotate", MAX_INPUT_BYTES, MAX_INPUT_TRIPLES),
    Endpoint("PUT", "/arm/actions/moveJoints", MAX_INPUT_BYTES, MAX_INPUT_TRIPLES),
    Endpoint("POST", "/arm/actions/followTrajectory", MAX_INPUT_BYTES, MAX_INPUT_TRIPLES),
    Endpoint("PUT", "/arm/pan/targetRotation", MAX_INPUT_BYTES, MAX_INPUT_TRIPLES),
    Endpoint("PUT", "/arm/title"),
    Endpoint("PUT", "/arm/annotations", triples=MAX_ANNOTATION_TRIPLES),
    Endpoint("PUT", "/arm/maximumSpeedScale"),
    Endpoint("PUT", "/arm/placement"),
    Endpoint("PUT", "/arm/lease"),
    Endpoint("POST", "/arm/pan/subscriptions"),
    Endpoint("POST", "/rules"),
    Endpoint("POST", "/world/objects", MAX_OBJECT_BYTES, MAX_OBJECT_TRIPLES),
    Endpoint("PATCH", "/arm/title", MAX_QUERY_BYTES),
    Endpoint("PATCH", "/arm/annotations", MAX_QUERY_BYTES),
    Endpoint("PATCH", "/arm/placement", MAX_QUERY_BYTES),
    Endpoint("PATCH", f"/arm/pan/subscriptions/{SUBSCRIPTION}", MAX_QUERY_BYTES),
)
QUERIES = Endpoint("POST", "/query", MAX_QUERY_BYTES)
LOGIN = Endpoint("POST", "/login", MAX_LOGIN_BYTES)
_UPDATES = {each: ("application/sparql-update", "") for each in ENDPOINTS if each.method == "PATCH"}
_OWN = {QUERIES: (QUERY, ""), LOGIN: (FORM, ""), **_UPDATES}
"""Endpoints that accept no RDF, with their media type and the beginning of each body."""


@dataclass(frozen=True)
class Attack:
    family: str
    endpoint: Endpoint
    media_type: str
    body: bytes


def _fill(piece: str, bytes_: int, before: str = "", after: str = "") -> str:
    """Repeat ``piece`` as often as there is room."""
    room = bytes_ - len(before.encode()) - len(after.encode())
    return before + piece * max(room // len(piece.encode()), 0) + after


def _numbered(piece: str, most: int, bytes_: int, before: str = "", between: str = "", after: str = "") -> str:
    """Repeat ``piece``, with # replaced by a number, at most ``most`` times and as often as there is room."""
    room, pieces = bytes_ - len(before) - len(after), list[str]()
    for number in range(most):
        made = piece.replace("#", str(number))
        room -= len(made) + len(between)
        if room < 0:
            break
        pieces.append(made)
    return before + between.join(pieces) + after


def _nested(bytes_: int, with_last: Mapping[str, Any]) -> str:
    """Nest objects 30 deep, each with many members before or after the inner one."""
    wide, inner = bytes_ // 30 // 14, dict[str, Any]()
    for _ in range(30):
        many: dict[str, Any] = {f"u:{number}": None if with_last else number for number in range(wide)}
        inner = {"u:p": inner, **many, **with_last} if with_last else {**many, "u:p": inner}
    return json.dumps(inner)


def _chain(bytes_: int, triples: int) -> str:
    context = {"a0": "http://" + "y" * 50} | {f"a{each}": f"a{each - 1}:" + "z" * 70 for each in range(1, 95)}
    return json.dumps({"@context": context, **{f"a94:{each}": None for each in range(min(triples * 7, bytes_ // 16))}})


_Family = Callable[[int, int], str]
"""From limits of bytes and triples to a body."""
_SYNTAXES: Mapping[str, Mapping[str, _Family]] = {
    TURTLE: {
        "spaces": lambda b, n: " " * b,
        "lines": lambda b, n: "\n" * b,
        "comments": lambda b, n: _fill("#\n", b),
        "late error": lambda b, n: "\n" * (b - 4) + "x y",
        "prefixes": lambda b, n: _numbered("@prefix a#: <a> .", b, b),
        "bases": lambda b, n: _fill("@base <a/> .", b, "@base <http://x/> ."),
        "long literal": lambda b, n: _fill("x", b, '<> lf:value "', '" .'),
        "escapes": lambda b, n: _fill("\\n", b, '<> <u:p> "', '" .'),
        "code points": lambda b, n: _fill("\\u00e9", b, '<> <u:p> "', '" .'),
        "long IRI": lambda b, n: _fill("x/", b, "<> <u:p> <", "> ."),
        "dots": lambda b, n: _fill("../", b, "<> <u:p> <", "> ."),
        "long number": lambda b, n: _fill("9", b, "<> <u:p> ", " ."),
        "deep nodes": lambda b, n: _fill("[<b> ", b, "<> <a> "),
        "deep lists": lambda b, n: _fill("(", b, "<> <a> "),
        "list": lambda b, n: _fill("1 ", min(b, n), "<> <a> (", ") ."),
        "digits": lambda b, n: _numbered("#" + "9" * 4000, n, b, "<> <u:p> ", ", ", " ."),
        "values": lambda b, n: _numbered("#", n - 2, b, "<> <u:unit> 1 ; <u:value> ", ", ", " ."),
        "nodes": lambda b, n: _numbered('[ <u:p> "#" ]', n // 2 - 1, b, "<> <u:p> ", ", ", " ."),
        "subjects": lambda b, n: _numbered("<u:#> <u:a> <u:#x> .", n - 1, b),
        "graph": lambda b, n: _numbered("_:b# <u:p> _:b0 .", n - 1, b),
    },
    TRIPLES: {
        "lines": lambda b, n: "\n" * b,
        "triples": lambda b, n: _numbered('<u:s> <u:p> "#" .\n', n, b),
        "chain": lambda b, n: _numbered("_:b# <u:p> _:c# .\n_:c# <u:p> _:b# .\n", n // 2, b),
    },
    XML: {
        "deep": lambda b, n: _fill('<r xmlns="u:">', b),
        "deep nodes": lambda b, n: _fill("<r><a>", b, _RDF),
        "deep XML literal": lambda b, n: _fill("<b>", b, f'{_RDF}<d><a r:parseType="Literal">'),
        "XML literal": lambda b, n: _fill("<b/>", b, f'{_RDF}<d><a r:parseType="Literal">', "</a></d></r:RDF>"),
        "members": lambda b, n: _fill("<r:li/>", min(b, 7 * n), f"{_RDF}<d>", "</d></r:RDF>"),
        "ids": lambda b, n: _numbered('<d r:ID="a#"/>', n, b, _RDF, "", "</r:RDF>"),
        "collection": lambda b, n: _fill("<d/>", b, f'{_RDF}<d><a r:parseType="Collection">', "</a></d></r:RDF>"),
        "attributes": lambda b, n: _numbered('a#=""', b, b, f"{_RDF}<d ", " ", "/></r:RDF>"),
        "namespaces": lambda b, n: _numbered('xmlns:a#="u:#"', b, b, f"{_RDF}<d ", " ", "/></r:RDF>"),
        "bases": lambda b, n: _fill('<d xml:base="x/"><a>', b, _RDF),
        "references": lambda b, n: _fill("&amp;", b, f"{_RDF}<d><a>", "</a></d></r:RDF>"),
        "instructions": lambda b, n: _fill("<?a?>", b),
        "comment": lambda b, n: _fill(" ", b, f"{_RDF}<!--", "--></r:RDF>"),
    },
    JSON_LD: {
        "scoped": lambda b, n: json.dumps(
            {"@context": {"a": {"@id": "u:a", "@context": ["/context"] * 200}}, "x": [{"a": {"a": 1}}] * (b // 20)}
        ),
        "nested contexts": lambda b, n: json.dumps({"u:p": [{"@context": "/context"}] * (b // 30)}),
        "contexts": lambda b, n: json.dumps({"@context": ["/context"] * (b // 13)}),
        "arrays": lambda b, n: _fill("[],", b, "[", "[]]"),
        "members": lambda b, n: json.dumps({f"a{each}": 1 for each in range(min(8 * n - 2, b // 12))}),
        "vocabulary": lambda b, n: json.dumps(
            {"@context": {"@vocab": "u:" + "y" * 250}, **{f"a{each}": None for each in range(min(8 * n - 4, b // 16))}}
        ),
        "chain of prefixes": _chain,
        "members before": lambda b, n: _nested(min(b, 100 * n), {}),
        "type last": lambda b, n: _nested(min(b, 100 * n), {"@type": "u:t"}),
        "id last": lambda b, n: _nested(min(b, 100 * n), {"@id": "u:t"}),
        "context last": lambda b, n: json.dumps({"u:p": [{"u:q": 1}] * (n // 2 - 1), "@context": {"a": "u:"}}),
        "code points": lambda b, n: _fill("\\u00e9", b, '{"u:p":"', '"}'),
        "pairs": lambda b, n: _fill("\\ud83d\\ude00", b, '{"u:p":"', '"}'),
        "half a pair": lambda b, n: _fill("\\ud83d\\ude00", b, '{"u:p":"', '\\ud800"}'),
        "JSON literal": lambda b, n: json.dumps({"u:p": {"@type": "@json", "@value": [[{"b": 1, "a": 2}]] * n}}),
        "reverse": lambda b, n: json.dumps({"@reverse": {"u:p": [{"@id": f"u:{each}"} for each in range(n - 1)]}}),
        "included": lambda b, n: json.dumps({"@included": [{"u:p": 1}] * (n - 1)}),
        "list of lists": lambda b, n: json.dumps({"u:p": {"@list": [[]] * (n // 2 - 2)}}),
        "index": lambda b, n: json.dumps(
            {"@context": {"m": {"@id": "u:m", "@container": "@index"}}, "m": {str(each): "x" for each in range(n - 1)}}
        ),
        "digits": lambda b, n: _fill("1" * 4000 + ",", b, '{"u:p":[', "1]}"),
        "lines": lambda b, n: _fill("\n", b, "{", "x"),
        "commas": lambda b, n: _fill(",", b, '{"u:p":"', '"}'),
        "deep": lambda b, n: _fill('{"a":', b),
    },
    JSON: {
        "deep": lambda b, n: _fill('{"a":', b),
        "deep arrays": lambda b, n: _fill("[", b),
        "members": lambda b, n: _numbered('"#":1', min(4 * n - 4, b), b, "{", ",", "}"),
        "values": lambda b, n: _fill("1,", min(b, 8 * n), '{"value":[', "1]}"),
        "targets": lambda b, n: _fill('{"ofJoint":"u:x","value":1},', min(b, 28 * n), '{"target":[', "{}]}"),
        "text": lambda b, n: _fill("x", b, '{"value":"', '"}'),
        "code points": lambda b, n: _fill("\\u00e9", b, '{"value":"', '"}'),
        "digits": lambda b, n: _fill("1", b, '{"value":', "}"),
        "fraction": lambda b, n: _fill("1", b, '{"value":0.', "}"),
        "long name": lambda b, n: _fill("x", b, '{"', '":1}'),
        "half a pair": lambda b, n: '{"value": "\\ud800"}',
        "name of half a pair": lambda b, n: '{"\\udfff": 1}',
    },
}


def _mesh(bytes_: int) -> str:
    count = min((bytes_ - 3000) // 4 * 3 // 50, 10_000)
    triangle = struct.pack("<12fH", *[0.5] * 12, 0)
    return base64.b64encode(b"\0" * 80 + struct.pack("<I", count) + triangle * count).decode()


def _object(literal: str) -> str:
    return (
        f'<> a lf:Obstacle ; dcterms:title "m" ; lf:position [ {_POINT} ] ; '
        f"lf:geometry [ a lf:TriangleMesh ; lf:stl {literal} ] ."
    )


def _bad_values(*predicates: str) -> _Family:
    """Return each predicate with values that violate the shape, so that the report is long."""

    def made(bytes_: int, triples: int) -> str:
        each = bytes_ // len(predicates) - 40
        return "[] " + " ; ".join(
            f"{name} " + _numbered(f'"#{"a" * min(each // 3, 4000)}"', triples // len(predicates), each, "", ", ")
            for name in predicates
        ) + " ."  # fmt: skip

    return made


_OF_PATH: Mapping[str, Mapping[str, _Family]] = {
    "followTrajectory": {
        "trajectory": lambda b, n: _numbered(
            f"[ lf:atTime #.5 ; lf:target {_PAN} , {_SLIDE} ]", n // 10 - 1, b, "<> lf:waypoint ", " , ", " ."
        ),
        "trajectory of bad units": lambda b, n: _numbered(
            f"[ lf:atTime #.5 ; lf:target {_PAN} , {_SLIDE.replace('unit:M', 'unit:RAD')} ]",
            n // 10 - 1, b, "<> lf:waypoint ", " , ", " .",
        ),
    },
    "rotate": {
        "bad values": _bad_values("vom:numericalValue", "vom:unit", "lf:speed", "lf:precondition"),
        "many values": lambda b, n: _numbered(
            "#", n - 2, b, "<> vom:unit unit:RAD ; vom:numericalValue ", ", ", " ."
        ),
        "huge values": lambda b, n: _numbered(
            "#" + "9" * 4000, n - 2, b, "<> vom:unit unit:RAD ; vom:numericalValue ", ", ", " ."
        ),
        "more": lambda b, n: _numbered(
            '[ lf:reason "#" ]', n // 2 - 2, b, "<> vom:unit unit:RAD ; vom:numericalValue 0 ; lf:reason ", ", ", " ."
        ),
    },
    "moveJoints": {
        "targets": lambda b, n: _numbered(_PAN, n // 4 - 1, b, "<> lf:target ", " , ", " ."),
        "preconditions": lambda b, n: _numbered(
            _PAN, n // 4 - 4, b, f"<> lf:target {_PAN} ; lf:precondition ", " , ", " ."
        ),
    },
    "title": {"bad values": _bad_values("lf:value")},
    "annotations": {
        "labels": lambda b, n: _numbered('"#"', n - 1, b, "</arm/> rdfs:label ", ", ", " ."),
        "long labels": lambda b, n: _numbered('"#' + "x" * 4000 + '"', n - 1, b, "</arm/> rdfs:label ", ", ", " ."),
        "quotes": lambda b, n: _numbered("'#" + '"' * 1990 + "'", n - 1, b, "</arm/> rdfs:label ", ", ", " ."),
        "nodes": lambda b, n: _numbered('[ rdfs:label "#" ]', n // 2 - 1, b, "</arm/> rdfs:seeAlso ", ", ", " ."),
        "links": lambda b, n: _numbered("</arm/#>", n - 1, b, "</arm/> rdfs:seeAlso ", ", ", " ."),
        "predicates": lambda b, n: _numbered("<http://x/#/a> 1", n - 1, b, "</arm/> ", " ; ", " ."),
        "poses": lambda b, n: _numbered(
            f'[ dcterms:title "#" ; lf:target {_PAN} ]', n // 6 - 1, b, "</arm/> lf:namedPose ", ", ", " ."
        ),
    },
    "subscriptions": {
        "bad values": _bad_values(
            "hybrit:onResource", "hybrit:callbackURL", "hybrit:mediaType", "lf:depth", "lf:minimumInterval",
            "lf:deadband", "lf:secret",
        ),
    },
    "rules": {
        "bad values": _bad_values(
            "dcterms:title", "lf:condition", "lf:invokes", "lf:body", "lf:toldApartBy", "lf:minimumInterval",
            "lf:enabled",
        ),
        "template": lambda b, n: _numbered(
            '[ lf:ofJoint [ lf:variable "a#" ] ; lf:w [ lf:variable "b#" ] ]', n // 5 - 3, b,
            '[] a lf:Rule ; dcterms:title "x" ; lf:condition "SELECT ?r { ?r a lf:Robot }" ; '
            "lf:invokes </arm/actions/moveJoints> ; lf:body [ lf:target ", ", ", " ] .",
        ),
    },
    "objects": {
        "mesh": lambda b, n: _object(f'"{_mesh(b)}"'),
        "mesh of spaces": lambda b, n: _object('"""' + "a " * (b // 2 - 1500) + '"""'),
        "mesh of escapes": lambda b, n: _object('"' + "\\n" * (b // 2 - 1500) + '"'),
        "mesh of another type": lambda b, n: _object('"' + "9" * (b - 3000) + '"^^xsd:integer'),
        "position": lambda b, n: _object('"x"').replace("maths:x 5", "maths:x " + "9" * (b - 3000)),
        "bad values": _bad_values("dcterms:title", "lf:geometry", "lf:position", "lf:orientation"),
    },
    "query": {
        "patterns": lambda b, n: _fill("?a ?b ?c . ", b, "SELECT ?a { "),  # left open, so that it is not evaluated
        "dots": lambda b, n: _fill(". ", b, "SELECT ?a { ", "}"),
        "prefixes": lambda b, n: _numbered("PREFIX a#: <a>", b, b, "", "", "SELECT ?a {}"),
        "bases": lambda b, n: _fill("BASE <./>", b, "BASE <http://x/" + "a/" * (b // 5) + ">", "SELECT ?a {}"),
        "graphs": lambda b, n: _fill("FROM <../a>", b, "BASE <http://x/" + "a/" * (b // 8) + ">SELECT ?a ", "{}"),
        "names": lambda b, n: _fill("a.", b, "SELECT ?a {", "}"),
        "more names": lambda b, n: _fill("a.b-", b, "SELECT ?a {", "}"),
        "escapes": lambda b, n: _fill("\\", b, "SELECT ?a {", "}"),
        "quotes": lambda b, n: _fill("'", b, "SELECT ?a {", "}"),
        "comparisons": lambda b, n: _fill("<", b, "SELECT ?a {", "}"),
        "percents": lambda b, n: _fill(":%", b, "SELECT ?a {", "}"),
        "variables": lambda b, n: _numbered("?a#", b, b, "SELECT ", " ", "{}"),
    },
    "update": {
        "facts": lambda b, n: _numbered('<> <u:p> "#" .', b, b, "INSERT DATA {", "", "}"),
        "lists": lambda b, n: _fill("(", b, "INSERT DATA { <> <u:p> "),
        "long literal": lambda b, n: _fill("x", b, 'INSERT DATA { <> <u:p> "', '" }'),
        "patterns": lambda b, n: _numbered("?a# ?p# ?b# .", b, b, "DELETE WHERE {", "", "}"),
        "one pattern": lambda b, n: _fill("?a ?b ?c .", b, "DELETE WHERE {", "}"),
        "template": lambda b, n: _numbered("?a <u:#> ?b .", b, b, "INSERT {", "", "} WHERE { ?a ?p ?b }"),
        "operations": lambda b, n: _fill("DELETE WHERE { ?a ?b ?c } ;", b),
        "prefixes": lambda b, n: _numbered("PREFIX a#: <a>", b, b, "", "", "INSERT DATA {}"),
        "quotes": lambda b, n: _fill("'", b, "INSERT DATA {", "}"),
        "comments": lambda b, n: _fill("#\n", b, "INSERT DATA {", "}"),
        "options": lambda b, n: _numbered(
            '"#"', b, b, "PREFIX lf: <https://w3id.org/linked-fleet#> INSERT DATA { <> lf:minimumInterval ", ",", "}"
        ),
        "secrets": lambda b, n: _numbered(
            '"whsec_#"', b, b, "PREFIX lf: <https://w3id.org/linked-fleet#> INSERT DATA { <> lf:secret ", ",", "}"
        ),
    },
    "login": {
        "fields": lambda b, n: _fill("a=&", b),
        "escapes": lambda b, n: _fill("%41", b, "token="),
    },
}  # fmt: skip


def attacks(endpoint: Endpoint, syntaxes: bool = True) -> list[Attack]:
    """Yield every family at full size: those of the endpoint, and of its media types."""
    bytes_ = endpoint.bytes_
    media_type, before = _OWN.get(endpoint, (TURTLE, TURTLE_PREFIXES))
    found = [(media_type, family, before, make) for family, make in _OF_PATH.get(endpoint.families, {}).items()]
    if syntaxes and endpoint not in _OWN:
        found += [(each, family, "", make) for each in _SYNTAXES for family, make in _SYNTAXES[each].items()]
    return [
        _attack(family, endpoint, each, before + make(bytes_ - len(before), endpoint.triples), bytes_)
        for each, family, before, make in found
    ]


def _attack(family: str, endpoint: Endpoint, media_type: str, text: str, bytes_: int) -> Attack:
    return Attack(family, endpoint, media_type, text.encode()[:bytes_])


def random_attack(random: Random) -> Attack:
    """Return an attack of random kind and size."""
    endpoint = random.choice((*ENDPOINTS, QUERIES))
    bytes_ = int(endpoint.bytes_ * random.choice((1, 1, 0.6, 0.25, 0.1)))
    triples = max(int(endpoint.triples * random.choice((1, 1, 0.6, 0.25))), 20)
    media_type, before = _OWN.get(endpoint, (TURTLE, TURTLE_PREFIXES))
    families = _OF_PATH.get(endpoint.families, {})
    if endpoint not in _OWN and (not families or random.random() < 0.7):
        media_type, before = random.choice(tuple(_SYNTAXES)), ""
        families = _SYNTAXES[media_type]
    family = random.choice(tuple(families))
    return _attack(family, endpoint, media_type, before + families[family](bytes_ - len(before), triples), bytes_)
