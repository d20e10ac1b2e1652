"""The page of the timeline: a row of bars for each robot, and a table of the same activities."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from pyoxigraph import NamedNode

from linked_fleet_gateway.api import DCTERMS, RDFS
from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.api import (
    Facts,
    Link,
    PageView,
    Part,
    Value,
    message,
    say,
    shows_past,
    translated,
)  # fmt: skip
from linked_fleet_gateway.extensions.timeline.chart import LANE, MOST_LANES, WIDTH, Scale, lanes, room_of, ticks
from linked_fleet_gateway.extensions.timeline.describing import PATH
from linked_fleet_gateway.extensions.timeline.terms import LF
from linked_fleet_gateway.extensions.timeline.window import (
    HOUR_NS,
    SECOND_NS,
    Window,
    at,
    lexical,
    moved,
    query_of,
    zoomed,
)
from linked_fleet_rdf.vocabulary import PROV

MOST_REPLAYED = 4
"""Robots that the page of a fleet shows as they were."""
MOST_ROWS = 4
"""Most robots of an activity that has a bar in the row of each; others are in the row of the fleet alone."""
_LOOKS = {
    "good": ("succeeded", "cleared", "noted"),
    "busy": ("accepted", "running", "starting", "ending"),
    "plan": ("planned", "waiting"),
    "warn": ("cancelled", "preempted", "paused", "blocked", "missed", "acknowledged"),
    "bad": ("failed", "raised", "confirmed"),
}
_LOOK = {state: look for look, states in _LOOKS.items() for state in states}
_SYMBOLS = {"good": "✓", "busy": "▸", "plan": "◷", "warn": "■", "bad": "✕", "odd": "?"}
_COLOURS = {
    "good": "succeeded", "busy": "running", "plan": "planned", "warn": "cancelled", "bad": "failed", "odd": "unknown",
}  # fmt: skip
"""The states by whose colours the looks are shown elsewhere."""
_SPANS = (
    (message("10 minutes"), HOUR_NS // 6), (message("2 hours"), 2 * HOUR_NS), (message("a day"), 24 * HOUR_NS),
    (message("7 days"), 168 * HOUR_NS),
)  # fmt: skip


@dataclass(frozen=True)
class Entry:
    """An activity in the table. ``look`` says in which way it is drawn, ``colour`` is the state that looks so."""

    link: Link
    kind: str
    state: str
    look: str
    colour: str
    who: str
    robots: Sequence[Link]
    begin: Value | None
    end: Value | None
    begin_s: float
    end_s: float

    @property
    def symbol(self) -> str:
        return _SYMBOLS[self.look]

    @property
    def label(self) -> str:
        """All that is to be said of its bar."""
        what, state = self.link.text, translated(self.state)
        if not self.who:
            return f"{what}, {state}"
        return say("{what}, {state}, by {who}", what=what, state=state, who=self.who)


@dataclass(frozen=True)
class Bar:
    """An activity in the chart. Its text is cut off where its room ends."""

    entry: Entry
    x: float
    y: int
    width: float
    room: float
    """The width of the bar, or more for its text."""


@dataclass(frozen=True)
class Row:
    """The bars of a robot, or of the fleet. ``alone`` is the address of its own timeline."""

    robot: Link
    alone: str
    bars: Sequence[Bar]
    height: int

    @property
    def said(self) -> str:
        count = len(self.bars)
        if not count:
            return say("nothing")
        if count == 1:
            return say("1 activity, listed below")
        return say("{count} activities, listed below", count=count)


def timeline(facts: Facts, iri: NamedNode) -> Part:
    window, now_s = _window(facts, iri), _seconds(facts, iri, LF.asOf)
    scale = Scale(window.from_ns / SECOND_NS, window.until_ns / SECOND_NS)
    nodes = facts.nodes(iri, LF.activity)
    entries = [_entry(facts, each, now_s) for each in nodes]
    robots = facts.nodes(iri, LF.shownRobot)
    address = facts.root.rstrip("/") + PATH
    more = {
        "width": WIDTH,
        "ticks": ticks(scale),
        "now": scale.at(now_s) if scale.begin_s <= now_s <= scale.end_s else None,
        "rows": _rows(facts, entries, robots, scale, f"{address}?", window),
        "entries": entries,
        "choices": _choices(entries),
        "ways": _ways(f"{address}?", window, int(now_s * SECOND_NS)),
        "everybody": f"{address}?{query_of(Window(window.from_ns, window.until_ns))}" if window.robot else "",
        "begin": facts.first_value(iri, LF.windowStart),
        "end": facts.first_value(iri, LF.windowEnd),
        "notes": _notes(facts, iri, window),
        "replayed": _replayed(facts, robots, entries, window),
        "from": lexical(window.from_ns),
        "until": lexical(min(window.until_ns, max(int(now_s * SECOND_NS), window.from_ns))),
    }
    shown = {LF.activity, LF.shownRobot, LF.windowStart, LF.windowEnd, LF.asOf, LF.leftOut, LF.completeFrom}
    shown |= {LF.completeUntil, LF.robotsLeftOut, LF.ofRobot, RDFS.seeAlso}
    title = say("Timeline of {robot}", robot=window.robot) if window.robot else say("Timeline")
    return Part(more, shown, {*nodes, *robots}, title)


def _replayed(facts: Facts, robots: Sequence[NamedNode], entries: Sequence[Entry], window: Window) -> list[Link]:
    """Return the robots that are shown as they were: those that do something, or the one of the timeline."""
    if not shows_past() or not robots:
        return []
    busy = {each.iri for entry in entries for each in entry.robots}
    found = [facts.place_link(each) for each in robots if window.robot or each.value in busy]
    return (found or [facts.place_link(robots[0])])[:MOST_REPLAYED]


def _window(facts: Facts, iri: NamedNode) -> Window:
    robot = facts.iri_of(iri, LF.ofRobot)
    begin_ns, end_ns = (round(_seconds(facts, iri, each) * 1000) * 1_000_000 for each in (LF.windowStart, LF.windowEnd))
    return Window(begin_ns, end_ns, texts.place(robot, facts.root) if robot else "")


def _seconds(facts: Facts, node: NamedNode, *predicates: NamedNode) -> float:
    """Return the first of some times in seconds since 1970; 0 if there is none."""
    text = next((found for each in predicates if (found := facts.text(node, each))), "")
    return datetime.fromisoformat(text).timestamp() if text else 0.0


def _entry(facts: Facts, node: NamedNode, now_s: float) -> Entry:
    begins = (PROV.startedAtTime, LF.plannedStart, DCTERMS.created)
    begin_s = _seconds(facts, node, *begins)
    end_s = _seconds(facts, node, PROV.endedAtTime)
    if not end_s:
        latest_s = _seconds(facts, node, LF.latestStart)
        end_s = max(begin_s, latest_s, now_s if facts.one(node, LF.plannedStart) is None else 0.0)
    state = texts.local_name(facts.iri_of(node, LF.state)).removeprefix("fault").lower()
    look, agent = _LOOK.get(state, "odd"), facts.one(node, PROV.wasAssociatedWith)
    of = facts.iri_of(node, LF.activityOf)
    kind, title = facts.text(node, LF.activityKind), facts.text(node, DCTERMS.title)
    return Entry(
        Link(texts.capitalized(title) if kind == "action" else title, of, of),
        kind,
        state,
        look,
        _COLOURS[look],
        facts.text(agent, DCTERMS.title) if agent is not None else "",
        [facts.place_link(each) for each in facts.nodes(node, LF.ofRobot)],
        next((found for each in begins if (found := facts.first_value(node, each))), None),
        facts.first_value(node, PROV.endedAtTime),
        begin_s,
        end_s,
    )


# -- the chart --------------------------------------------------------------------------------------------------------


def _rows(
    facts: Facts, entries: Sequence[Entry], robots: Sequence[NamedNode], scale: Scale, address: str, window: Window
) -> list[Row]:
    of: dict[str, list[Entry]] = {}
    for each in entries:
        names = [robot.iri for robot in each.robots]
        for name in names if 0 < len(names) <= MOST_ROWS or window.robot else [""]:
            of.setdefault(name, []).append(each)
    rows = [] if window.robot else [_row(Link(say("Fleet"), facts.root, facts.root), "", of.get("", []), scale)]
    for iri in robots:
        robot = facts.place_link(iri)
        alone = "" if window.robot else address + query_of(Window(window.from_ns, window.until_ns, robot.text))
        rows.append(_row(robot, alone, of.get(iri.value, []), scale))
    return rows


def _row(robot: Link, alone: str, entries: Sequence[Entry], scale: Scale) -> Row:
    extents = [scale.extent(each.begin_s, each.end_s) for each in entries]
    rooms = [(x, max(width, room_of(each.link.text))) for each, (x, width) in zip(entries, extents, strict=True)]
    placed = lanes(rooms)
    if max(placed, default=0) == MOST_LANES - 1:  # too many for texts beside bars
        rooms, placed = extents, lanes(extents)
    bars = [
        Bar(entry, x, lane * LANE + 2, width, room)
        for entry, (x, width), (_, room), lane in zip(entries, extents, rooms, placed, strict=True)
    ]
    return Row(robot, alone, bars, LANE * (max(placed, default=0) + 1) + 2)


def _choices(entries: Sequence[Entry]) -> list[tuple[str, str, list[str]]]:
    return [
        ("kind-of", say("Kind"), sorted({each.kind for each in entries})),
        ("state-name", say("State"), sorted({each.state for each in entries})),
        ("who", say("Who"), sorted({each.who for each in entries if each.who})),
    ]


# -- other windows ----------------------------------------------------------------------------------------------------


def _ways(address: str, window: Window, now_ns: int) -> list[Link]:
    """Return the links to other windows."""
    found = [
        (say("Earlier"), moved(window, -0.5)),
        (say("Later"), moved(window, 0.5)),
        (say("Zoom in"), zoomed(window, 0.5)),
        (say("Zoom out"), zoomed(window, 2.0)),
        (say("Now"), at(window, now_ns)),
    ]
    found += [(translated(text), at(Window(0, length_ns, window.robot), now_ns)) for text, length_ns in _SPANS]
    return [Link(text, address + query_of(each), "") for text, each in found]


def _notes(facts: Facts, iri: NamedNode, window: Window) -> list[str]:
    """Return sentences about what is not shown."""
    found = list[str]()
    if (count := int(facts.text(iri, LF.leftOut) or 0)) > 0:
        since = texts.time_text(facts.text(iri, LF.completeFrom))
        found.append(
            say(
                "{count} activities that began before {since} are left out. Zoom in to see them.",
                count=count,
                since=since,
            )
        )
    if _seconds(facts, iri, LF.completeUntil) * SECOND_NS < window.until_ns - SECOND_NS // 1000:
        until = texts.time_text(facts.text(iri, LF.completeUntil))
        found.append(say("Starts of schedules from {until} on are left out. Zoom in to see them.", until=until))
    if (idle := int(facts.text(iri, LF.robotsLeftOut) or 0)) > 0:
        found.append(say("{count} robots that do nothing in this time are left out.", count=idle))
    return found


VIEW = PageView(
    LF.Timeline,
    Path(__file__).parent / "templates" / "timeline.html",
    timeline,
    {"timeline": PATH},
    help=message("What happened, what happens now and what is planned, robot by robot."),
    guide="docs/MAP.md",
)
