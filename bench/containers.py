"""The cost of a GET of what grows: the fleet, robots, Subscriptions containers and histories.

Requests vary as in ``bench.answers``: each is for a random robot, joint or link, with one of several queries, in Turtle
or JSON-LD. Meanwhile five simulated robots move at 100 Hz, so that values change between requests. The last row has all
four kinds, equally often.
"""

import random
import tempfile
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import chain
from urllib.parse import quote, urlsplit

import httpx
from pyoxigraph import RdfFormat, parse

from bench.answers import browse, listed, typical_response
from bench.beside import BARE, bare
from bench.scene import scene_of_robots
from bench.table import Row, at_least, known
from shared_fixtures import ROBOTS

_LINES = 400
"""Different requests of each kind."""
_GOAL = 0.3
_RECORDED_S = 12.0
_MIXED = "/mixed"
_KINDS = {
    "/fleet": "GET of `/`",
    "/robot": "GET of a random robot",
    "/subscriptions": "GET of the subscriptions of a random robot, joint or link",
    "/history": "GET of a random history, up to its last ten seconds",
    _MIXED: "GET of one of these, at random",
}
_PLAIN = ("", "", "?as=turtle", "?as=jsonld")
"""Queries of representations: half of the requests have none."""


def rows(seconds: float) -> list[Row]:
    with scene_of_robots("--requests-per-client", "0") as (place, _), tempfile.TemporaryDirectory() as folder:
        root = place.place.root
        time.sleep(_RECORDED_S)  # a history is as long as its robot has moved
        asked = _asked(root)
        constants = {name: typical_response(root, lines) for name, lines in asked.items()}
        found = list[Row]()
        with bare(1, constants) as (url, pid):
            for name, what in _KINDS.items():
                browse(root, place.pid, seconds, listed(folder, "warm", asked[name]))
                theirs = browse(url, pid, seconds, listed(folder, "bare", [(name,)])).per_cpu_s
                ours = browse(root, place.pid, seconds, listed(folder, "paths", asked[name])).per_cpu_s
                size = sum(len(key) + len(value) for key, value in constants[name].fields.items())
                beside = f"{BARE}, {constants[name].size:,} constant bytes and {size:,} of fields"
                goal = _GOAL if name == _MIXED else None
                found.append(
                    known(what, "1/CPU s", ours, beside, theirs)
                    if goal is None
                    else at_least(what, "1/CPU s", ours, beside, theirs, goal)
                )
    return found


def _asked(root: str) -> dict[str, list[tuple[str, ...]]]:
    """Return the requests of each kind, as lines of a file for ``browse``."""
    chance = random.Random(1)  # noqa: S311
    robots = [f"/{name}/" for name in ROBOTS]
    things = [*robots, *chain.from_iterable(_linked(root, robot, "hasPart") for robot in robots)]
    histories = [f"{robot}history" for robot in robots]
    histories += [path for robot in robots for path in _linked(root, f"{robot}history", "hasPart")]
    found = {
        "/fleet": _drawn(chance, ["/"], _PLAIN),
        "/robot": _drawn(chance, robots, _PLAIN),
        "/subscriptions": _drawn(chance, [f"{each.rstrip('/')}/subscriptions" for each in things], _PLAIN),
        "/history": [(chance.choice(histories) + _span(chance),) for _ in range(_LINES)],
    }
    return {**found, _MIXED: list(chain.from_iterable(found.values()))}


def _drawn(chance: random.Random, paths: Sequence[str], queries: Sequence[str]) -> list[tuple[str, ...]]:
    return [(chance.choice(paths) + chance.choice(queries),) for _ in range(_LINES)]


def _span(chance: random.Random) -> str:
    """Return the query of a part of a history: the newest samples, a number of them, or a span."""
    begin = datetime.fromtimestamp(time.time() - chance.uniform(0, 10), UTC).isoformat()
    limit = chance.randint(1, 20)
    last = chance.randint(1, 9)
    return chance.choice(["", f"?limit={limit}", f"?last=PT{last}S", "?last=PT10S", f"?from={quote(begin)}&limit=10"])


def _linked(root: str, path: str, term: str) -> list[str]:
    """Return the paths that a resource links by the term, in their order."""
    content = httpx.get(root.rstrip("/") + path, headers={"accept": "application/n-triples"}).raise_for_status()
    triples = parse(content.content, RdfFormat.N_TRIPLES)
    linked = [each.object.value for each in triples if each.predicate.value.endswith(f"/{term}")]
    return [urlsplit(each).path for each in linked]
