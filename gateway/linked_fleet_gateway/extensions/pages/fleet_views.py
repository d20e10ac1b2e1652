"""The view of the fleet: a card or a row of a table for each robot, filtered and sorted as the address says.

The address has all of that (`/?view=table&sort=battery&tag=arms`), so that a view can be sent to a colleague, and works
without scripts.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from urllib.parse import parse_qsl, urlencode, urlsplit

from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.assets import THUMBNAIL
from linked_fleet_gateway.extensions.pages.languages import message, say, translated
from linked_fleet_gateway.extensions.pages.thing_views import Presence, actions, path_below, presence
from linked_fleet_gateway.extensions.pages.values import Facts, Link, Time
from linked_fleet_gateway.extensions.pages.views import LF, Part, constant
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LDP, PROV, VOM, XSD

LOW_PERCENT = 20.0
"""Charge in percent below which a card says that the battery is low; also in `scripts/src/fleet.js`."""
_SAID = LF.extended("outOfService stopped tag openFaults worstSeverity trouble")
_PRESENCES = ("online", "faulty", "offline")
_SEVERITIES = ("critical", "error", "warning", "information")
_LINKS = {"linkLost": "lost", "linkWeak": "weak", "linkGood": "good"}
_LINK_HINT = message(
    "Good: of the frames of the last ten seconds at least 98 % have arrived. Weak: less than 95 %. Lost: the agent is"
    " connected, and no frame has arrived for 3 s."
)
_LINK_HINTS = {
    "good": message("at least 98 % of its frames arrive"),
    "weak": message("less than 95 % of its frames of the last 10 s have arrived"),
    "lost": message("connected, but no frame has arrived for 3 s"),
}
"""Also in `scripts/src/fleet.js`."""
_TROUBLE, _DESCENDING = "trouble", "descending"
ROWS = 200
"""Rows on one page of the table: as many as a browser lays out at once without being felt."""
_FILTERS = ("text", "presence", "kind", "tag")
_ASKED = ("view", "sort", "order", *_FILTERS, "page")
"""The parameters of an address, in this order."""
_WELL = 9
_DOCS = "https://w3id.org/linked-fleet/source/HEAD/"
"""The address of the documentation; deploy/w3id/.htaccess says where this leads."""


@dataclass(frozen=True)
class RobotCard:
    """A robot in the fleet's list.

    ``model``: its kind. ``task``: its current activity in words, empty if none. ``holder`` has control of it.
    ``out_of_service`` and ``stopped`` say why it is. ``battery``: the charge in percent, empty if unknown.
    ``quality``: how well its frames arrive, in a word. ``thumbnail``: the path of its drawing. ``trouble`` is the title
    of the worst of its ``faults`` open faults, and ``severity`` that of this one. ``hidden``: a filter leaves it out.
    """

    link: Link
    name: str
    model: str
    presence: Presence
    task: str
    moving: bool
    moved: Time | None
    holder: str
    out_of_service: str
    stopped: str
    battery: str
    quality: str
    tags: Sequence[str]
    trouble: str
    severity: str
    faults: int
    thumbnail: str
    hidden: bool = False

    @property
    def low(self) -> bool:
        return bool(self.battery) and float(self.battery) < LOW_PERCENT

    @property
    def state(self) -> str:
        return self.presence.state.name if self.presence.state else ""

    @property
    def rank(self) -> int:
        """Its place among the others: those with trouble come first, as in `faults/scripts/page.js`."""
        of_presence = 3 if self.state in ("faulty", "offline") else _WELL
        return min(of_presence, 2 * _SEVERITIES.index(self.severity)) if self.severity in _SEVERITIES else of_presence

    def fits(self, asked: Mapping[str, str]) -> bool:
        """Return True if the filters of an address show it, as `scripts/src/fleet.js` does."""
        said = f"{self.name} {self.link.text} {self.model} {' '.join(self.tags)}".lower()
        return (
            all(word in said for word in asked.get("text", "").lower().split())
            and asked.get("presence") in (None, "", self.state)
            and asked.get("kind") in (None, "", self.model)
            and (not asked.get("tag") or asked["tag"] in self.tags)
        )


@dataclass(frozen=True)
class Column:
    """A column of the table. ``key``: what rows are sorted by; what is unknown is last in both directions."""

    name: str
    title: str
    key: Callable[[RobotCard], object]
    hint: str = ""


_COLUMNS = (
    Column("name", message("Robot"), lambda each: each.link.text.casefold()),
    Column("model", message("Model"), lambda each: each.model.casefold() or None),
    Column("state", message("State"), lambda each: (each.rank, not each.stopped, not each.out_of_service)),
    Column("doing", message("Doing"), lambda each: (not each.task, not each.moving, each.task)),
    Column("holder", message("Controlled by"), lambda each: each.holder.casefold() or None),
    Column("faults", message("Faults"), lambda each: (each.rank, -each.faults)),
    Column("battery", message("Battery"), lambda each: float(each.battery) if each.battery else None),
    Column(
        "link", message("Connection"), lambda each: list(_LINKS.values()).index(each.quality) if each.quality else None,
        _LINK_HINT,
    ),
    Column("tags", message("Tags"), lambda each: ", ".join(each.tags).casefold() or None),
    Column(
        "moved", message("Last moved"),
        lambda each: "~" if each.moving else each.moved.datetime if each.moved else None,
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Head:
    """The head of a column. ``sorted``: the value of aria-sort, empty if rows are not sorted by it."""

    title: str
    href: str
    sorted: str
    hint: str


@dataclass(frozen=True)
class Rows:
    """The robots on one page of the table, of ``count`` that fit; ``former`` and ``following`` are addresses."""

    robots: Sequence[RobotCard]
    begin: int
    count: int
    former: str
    following: str


@dataclass(frozen=True)
class Choice:
    """The choices in an address. ``note``: those that there are not."""

    values: Mapping[str, str]
    note: str = ""

    @property
    def table(self) -> bool:
        return self.values.get("view") == "table"

    @property
    def column(self) -> Column | None:
        return next((each for each in _COLUMNS if each.name == self.values.get("sort")), None)

    @property
    def descending(self) -> bool:
        return self.values.get("order") == _DESCENDING

    def with_(self, **changed: str) -> str:
        """Return the address of the first page with some values replaced; empty ones are left out."""
        said = {**self.values, "page": "", **changed}
        found = {name: said[name] for name in _ASKED if said.get(name)}
        return "/?" + urlencode(found) if found else "/"

    def rows(self, robots: Sequence[RobotCard]) -> "Rows":
        """Return the page of the table that is asked for, the last one if there are fewer."""
        fitting = [each for each in robots if not each.hidden]
        pages = max(1, -(-len(fitting) // ROWS))
        page = min(max(1, int(self.values.get("page", "1"))), pages)
        begin = (page - 1) * ROWS
        former = self.with_(page=str(page - 1)) if page > 1 else ""
        following = self.with_(page=str(page + 1)) if page < pages else ""
        return Rows(fitting[begin : begin + ROWS], begin, len(fitting), former, following)

    def heads(self) -> list[Head]:
        return [self._head(each) for each in _COLUMNS]

    def _head(self, column: Column) -> Head:
        mine = column == self.column
        turned = _DESCENDING if mine and not self.descending else ""
        state = ("descending" if self.descending else "ascending") if mine else ""
        return Head(
            translated(column.title), self.with_(sort=column.name, order=turned), state, translated(column.hint)
        )

    def sorted(self, robots: Sequence[RobotCard]) -> list[RobotCard]:
        by_trouble = sorted(robots, key=lambda each: each.rank)
        if self.column is None:
            return by_trouble
        key = self.column.key
        known = [each for each in by_trouble if key(each) is not None]
        known.sort(key=lambda each: key(each), reverse=self.descending)  # type: ignore[arg-type,return-value]
        return [*known, *(each for each in by_trouble if key(each) is None)]


def read_choice(query: str) -> Choice:
    """Return what a query asks for; of what has no meaning a note."""
    said = {name: value[:200] for name, value in parse_qsl(query, keep_blank_values=True, max_num_fields=100)[:20]}
    known = {name: said[name] for name in _ASKED if said.get(name)}
    notes = []
    for name, allowed in _ALLOWED.items():
        if known.get(name, allowed[0]) not in allowed:
            wrong = repr(texts.clean(known.pop(name)))
            notes.append(
                say(
                    "There is no {name} {text}; it can be {allowed}.", name=name, text=wrong, allowed=", ".join(allowed)
                )
            )
    if not known.get("page", "1").isdecimal() or len(known.get("page", "1")) > 6:
        wrong = repr(texts.clean(known.pop("page")))
        notes.append(say("There is no page {page}; pages are counted from 1.", page=wrong))
    if known.get("sort") == _TROUBLE:
        del known["sort"]
    return Choice(known, " ".join(notes))


_ALLOWED: Mapping[str, Sequence[str]] = {
    "view": ("cards", "table"),
    "sort": (_TROUBLE, *(each.name for each in _COLUMNS)),
    "order": ("ascending", _DESCENDING),
    "presence": _PRESENCES,
}


def fleet(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    choice = _choice(facts.query)
    robots = choice.sorted([_card(facts, each, choice.values) for each in members])
    more = {
        "robots": robots,
        "rows": choice.rows(robots) if choice.table else None,
        "shown": sum(not each.hidden for each in robots),
        "counts": _counts(robots),
        "kinds": sorted({each.model for each in robots if each.model}),
        "tags": sorted({tag for each in robots for tag in each.tags}),
        "presences": _PRESENCES,
        "choice": choice,
        "hint": {quality: translated(hint) for quality, hint in _LINK_HINTS.items()},
        "host": _host(facts.root),
        "docs": _DOCS,
        "actions": actions(facts, iri),
        "world": facts.iri_of(iri, LF.world),
        "objects": constant("objects"),
    }
    # The navigation links everything else of the fleet.
    linked = {each for each in facts.of.get(iri, {}) if _leads_on(facts, iri, each)} - {DCTERMS.title}
    return Part(more, {LDP.contains, HYBRIT.action, *linked}, set(members))


def _host(root: str) -> str:
    """Return the host by which the reader reaches the gateway, as an endpoint of Zenoh has it."""
    host = urlsplit(root).hostname or "127.0.0.1"
    return f"[{host}]" if ":" in host else host


def _choice(query: str) -> Choice:
    try:
        return read_choice(query)
    except ValueError as error:  # more fields than anybody needs
        return Choice({}, say("The address cannot be read: {reason}.", reason=error))


def _card(facts: Facts, iri: NamedNode, asked: Mapping[str, str]) -> RobotCard:
    tasks = facts.nodes(iri, LF.currentTask)
    moved = facts.values(iri, LF.lastMoved)
    found = RobotCard(
        facts.link(iri),
        texts.place(iri.value, facts.root),
        facts.text(iri, LF.modelName),
        presence(facts, iri),
        _doing(facts, tasks[0]) if tasks else "",
        facts.one(iri, LF.moving) == Literal("true", datatype=XSD.boolean),
        moved[0] if moved and isinstance(moved[0], Time) else None,
        _holder(facts, iri),
        facts.text(iri, _SAID.outOfService),
        facts.text(iri, _SAID.stopped),
        _percent(facts.text(iri, LF.batteryCharge)),
        _LINKS.get(texts.local_name(facts.iri_of(iri, LF.linkQuality)), ""),
        sorted(texts.clean(each.value) for each in facts.all(iri, _SAID.tag) if isinstance(each, Literal)),
        facts.text(iri, _SAID.trouble),
        facts.text(iri, _SAID.worstSeverity),
        int(facts.text(iri, _SAID.openFaults) or 0),
        path_below(iri.value, facts.root) + THUMBNAIL,
    )
    return found if found.fits(asked) else replace(found, hidden=True)


def _doing(facts: Facts, task: NamedNode) -> str:
    """Return what a robot does, how far it is, and for whom; as ``doing`` of `scripts/src/fleet.js`."""
    share, client = facts.one(task, LF.progress, VOM.numericalValue), facts.one(task, PROV.wasAssociatedWith)
    far = f" {100 * float(share.value):.0f} %" if isinstance(share, Literal) else ""
    who = facts.text(client, DCTERMS.title) if isinstance(client, BlankNode) else ""
    done = texts.task(task.value, facts.root) + far
    return say("{what} for {who}", what=done, who=who) if who else done


def _holder(facts: Facts, iri: NamedNode) -> str:
    holder = facts.one(iri, LF.lease, LF.holder)
    return texts.clean(holder.value) if isinstance(holder, Literal) else ""


def _percent(charge: str) -> str:
    """Return a charge without decimals; empty if it is empty."""
    return f"{float(charge):.0f}" if charge else ""


def _counts(robots: Sequence[RobotCard]) -> list[tuple[str, int]]:
    found = Counter(each.state for each in robots)
    return [(name, found[name]) for name in _PRESENCES if found[name]]


def _leads_on(facts: Facts, iri: NamedNode, predicate: NamedNode) -> bool:
    values = facts.all(iri, predicate)
    return all(isinstance(each, NamedNode) and each.value.startswith(facts.root) for each in values)
