"""The pages of rules: a list with switches and an editor, one rule, and its firings.

The list has examples; those for the demo can be saved unchanged.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.api import Right
from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.api import message, say, translated
from linked_fleet_gateway.extensions.pages.form_parts import Form, Group, Leaf
from linked_fleet_gateway.extensions.pages.values import Facts, Link, Value
from linked_fleet_gateway.extensions.pages.views import PageView, Part
from linked_fleet_gateway.extensions.rules.request import RULE_SHAPE
from linked_fleet_gateway.extensions.rules.template import LF, as_turtle
from linked_fleet_rdf.vocabulary import DCTERMS, LDP

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.pages import form
else:
    form = LazyModule("linked_fleet_gateway.extensions.pages.form")


_LF = "PREFIX lf: <https://w3id.org/linked-fleet#>\n"


@dataclass(frozen=True)
class Example:
    """An example. ``invokes`` is the path of an action, ``body`` Turtle about ``_:body``, its input."""

    title: str
    comment: str
    condition: str
    invokes: str
    body: str = ""
    told_apart_by: str = ""


UPRIGHT = Example(
    message("The UR5 stands up when its wrist turns too far"),
    message("Turn wrist_3_joint of the UR5 beyond 1 rad (57°) to see it fire."),
    _LF
    + """PREFIX ros: <http://ros.org/#>
PREFIX spatial: <http://vocab.arvida.de/2015/06/spatial/vocab#>
PREFIX vom: <http://vocab.arvida.de/2015/06/vom/vocab#>
SELECT ?joint ?angle WHERE {
  BIND(</ur5/wrist_3_joint> AS ?joint)
  ?joint ros:rotation/spatial:rotationAngle/vom:numericalValue ?angle .
  FILTER(?angle > 1)
}
""",
    "/ur5/actions/assumePose",
    """@prefix lf: <https://w3id.org/linked-fleet#> .

_:body lf:poseName "upright" .
""",
    "joint",
)
GREET = Example(
    message("The Panda opens its hand when the UR5 moves"),
    message("Move any joint of the UR5 to see it fire, once for each motion."),
    _LF
    + """SELECT ?task WHERE {
  </ur5/> lf:currentTask ?task .
}
""",
    "/panda/panda_finger_joint1/actions/translate",
    """@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
@prefix unit: <http://qudt.org/vocab/unit/> .

_:body vom:numericalValue 0.04 ; vom:unit unit:M .
""",
)
KEEP_AWAY = Example(
    message("The UR5 stops when it comes near to the Panda"),
    message(
        "Bring the tool of the UR5 nearer than 0.4 m to the hand of the Panda to see it fire. It is no safety function."
    ),
    _LF
    + """SELECT ?tool WHERE {
  BIND(</ur5/tool0> AS ?tool)
  FILTER(lf:distance(?tool, </panda/panda_hand>) < 0.4)
}
""",
    "/ur5/actions/stop",
)
EXAMPLES = (UPRIGHT, GREET, KEEP_AWAY)


_TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class FiringRow:
    """A firing in a table; ``did`` links its invocation while that exists."""

    link: Link
    when: Value | None
    state: Value | None
    reason: str
    did: Link | None
    bindings: Sequence[tuple[str, Value]]


@dataclass(frozen=True)
class RuleRow:
    """A rule in the list."""

    link: Link
    enabled: bool
    state: Value | None
    reasons: Sequence[str]
    last: FiringRow | None


def rules(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    firings = [each for member in members for each in facts.nodes(member, LF.lastFiring)]
    first = EXAMPLES[0]
    values = {
        DCTERMS.title: translated(first.title),
        LF.condition: first.condition,
        LF.invokes: first.invokes,
        LF.body: first.body,
        LF.toldApartBy: first.told_apart_by,
        LF.minimumInterval: "1",
        LF.holdsFor: "0",
        LF.enabled: "true",
    }
    blank = form.form_of_shape(
        LF.RuleShape, iri.value, "POST", say("Save the rule"), facts, iri, Right.SUBSCRIBE, RULE_SHAPE
    )
    more = {
        "listed": [_listed(facts, each) for each in members],
        "examples": EXAMPLES,
        "form": _form(blank, values),
    }
    return Part(more, {LDP.contains, LDP.constrainedBy, LF.vocabulary}, {*members, *firings})


def rule(facts: Facts, iri: NamedNode) -> Part:
    """Show one rule; ``firings`` is the URL of the page of its firings."""
    body, node = facts.one(iri, LF.body), facts.one(iri, LF.invokes)
    values = {
        LF.body: as_turtle(facts.triples, body) if isinstance(body, BlankNode) else "",
        LF.invokes: f"?{facts.text(node, LF.variable)}" if isinstance(node, BlankNode) else getattr(node, "value", ""),
        LF.condition: getattr(facts.one(iri, LF.condition), "value", ""),
    }
    own = form.form_of_shape(
        LF.RuleShape, iri.value, "PUT", say("Save the changes"), facts, iri, Right.SUBSCRIBE, RULE_SHAPE
    )
    more = {
        "form": _form(own, values),
        "enabled": _enabled(facts, iri),
        "state": facts.first_value(iri, LF.state),
        "reasons": [each.value for each in facts.all(iri, LF.reason) if isinstance(each, Literal)],
        "firings": facts.iri_of(iri, LF.firings),
    }
    return Part(more, {LF.condition, LF.invokes, LF.body, LF.enabled, LF.state, LF.reason, LF.firings})


def _form(made: Form, values: Mapping[NamedNode, str]) -> Form:
    """Return the form with these values; the optional body of the action is placed beside the action."""
    fields = [_with(each, values) for each in (*made.needed, *made.further)]
    needed = [each for each in fields if each.required or each.path == LF.body.value]
    return replace(made, needed=needed, further=[each for each in fields if each not in needed])


def _with(field: Leaf | Group, values: Mapping[NamedNode, str]) -> Leaf | Group:
    if field.path == LF.toldApartBy.value:
        field = replace(field, label=texts.term_in_words(field.path))
    value = values.get(NamedNode(field.path))
    return field if value is None or isinstance(field, Group) else replace(field, value=value)


def firings(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    return Part({"fired": [_fired(facts, each) for each in members]}, {LDP.contains}, set(members))


def _listed(facts: Facts, iri: NamedNode) -> RuleRow:
    last = facts.one(iri, LF.lastFiring)
    return RuleRow(
        facts.link(iri),
        _enabled(facts, iri),
        facts.first_value(iri, LF.state),
        [texts.clean(each.value) for each in facts.all(iri, LF.reason) if isinstance(each, Literal)],
        _fired(facts, last) if isinstance(last, NamedNode) else None,
    )


def _fired(facts: Facts, iri: NamedNode) -> FiringRow:
    invocation = facts.one(iri, LF.invocation)
    did = None
    if isinstance(invocation, NamedNode):
        text = texts.capitalized(texts.motion(invocation.value, facts.root, {}))
        did = Link(text, invocation.value, invocation.value)
    number = texts.local_name(iri.value)
    bindings = [
        (facts.text(node, LF.variable), value)
        for node in facts.all(iri, LF.binding)
        for value in facts.values(node, LF.value)  # type: ignore[arg-type]
    ]
    return FiringRow(
        Link(say("Firing {number}", number=number), iri.value, iri.value),
        facts.first_value(iri, DCTERMS.created),
        facts.first_value(iri, LF.state),
        facts.text(iri, LF.reason),
        did,
        bindings,
    )


def _enabled(facts: Facts, iri: NamedNode) -> bool:
    return facts.text(iri, LF.enabled) == "true"


RULES = PageView(
    LF.RuleList,
    _TEMPLATES / "rules.html",
    rules,
    help=message(
        "Rules start an action by themselves when something happens, such as a stop when two robots come near."
        " They are no safety function."
    ),
    guide="docs/MAP.md",
)
RULE = PageView(
    LF.Rule,
    _TEMPLATES / "rule.html",
    rule,
    help=message(
        "One rule: when it acts, what it does, and when it did so last. Switch it off to keep it without effect."
    ),
    guide="docs/MAP.md",
)
FIRINGS = PageView(
    LF.FiringList,
    _TEMPLATES / "firings.html",
    firings,
    help=message("When the rule acted, and what became of it."),
    guide="docs/MAP.md",
)
