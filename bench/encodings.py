"""Content codings: bytes and processor of responses in gzip beside those without, and of static files."""

import contextlib
import random
import re
import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple
from urllib.parse import urlsplit

import httpx
from pyoxigraph import NamedNode, RdfFormat, parse

from bench.scene import Scene, cpu_s, scene_of_robots
from bench.table import Row, known
from bench.varied import ENCODINGS, Client
from browser import HYBRIT
from linked_fleet_rdf.vocabulary import DCTERMS
from shared_fixtures import ROBOTS

_ASSET = re.compile(r'(?:src|href)="(/assets/[^"]+\.(?:js|css))"')
_CODINGS = {"without a content coding": "identity", "gzip": "gzip", "br": "br"}


class Cost(NamedTuple):
    """Mean of one response: bytes of its content, and processor time of the gateway in us."""

    size: float
    us: float


def rows(seconds: float) -> list[Row]:
    """Measure resources that were read before, as random clients ask for them one after the other."""
    with scene_of_robots("--requests-per-client", "0") as (place, browser):
        paths = _paths(place.place.root, [browser.robot(name).url for name in ROBOTS])
        idle = _idle(place, seconds)
        found = []
        for what, resources in paths.items():
            name = f"GET of a random {what}, read before"
            plain, coded = (_cost(place, resources, each, seconds, idle) for each in ("identity", ENCODINGS))
            found += _beside(name, "gzip", coded, "without a content coding", plain)
        found += list(_static(place, seconds, idle))
    return found


def _beside(name: str, coding: str, coded: Cost, reference: str, plain: Cost) -> Iterator[Row]:
    for unit, value, beside in (("B", coded.size, plain.size), ("us CPU", coded.us, plain.us)):
        yield known(f"{name}, {reference}, {unit}", unit, beside)
        yield known(f"{name}, {coding}, {unit}", unit, value, reference, beside)


def _paths(root: str, robots: Sequence[str]) -> dict[str, list[str]]:
    """Return the paths of all robots, of their joints and links, and of their blueprints."""
    parts, blueprints = list[str](), set[str]()
    for robot in robots:
        of_robot, own = _links(robot, root)
        blueprints |= own
        parts += of_robot
    for part in parts:
        blueprints |= _links(part, root)[1]
    found = {"robot": robots, "joint or link": parts, "blueprint": sorted(blueprints)}
    return {what: [urlsplit(iri).path for iri in iris] for what, iris in found.items()}


def _links(iri: str, root: str) -> tuple[list[str], set[str]]:
    """Return the parts of a resource, and its blueprints at this gateway."""
    parts, blueprints = list[str](), set[str]()
    content = httpx.get(iri, headers={"accept": "application/n-triples"}, timeout=60).raise_for_status().content
    for triple in parse(content, RdfFormat.N_TRIPLES):
        if triple.subject == NamedNode(iri) and isinstance(triple.object, NamedNode):
            if triple.predicate == DCTERMS.hasPart:
                parts.append(triple.object.value)
            elif triple.predicate.value == str(HYBRIT.blueprint) and triple.object.value.startswith(root):
                blueprints.add(triple.object.value)
    return parts, blueprints


def _static(place: Scene, seconds: float, idle: float) -> Iterator[Row]:
    """Measure the scripts and styles that the front page names."""
    page = httpx.get(place.place.root, headers={"accept": "text/html"}, timeout=60).text
    paths = sorted(set(_ASSET.findall(page)))
    costs = {name: _cost(place, paths, coding, seconds, idle) for name, coding in _CODINGS.items()}
    plain = next(iter(costs))
    for unit, of in (("B", lambda cost: cost.size), ("us CPU", lambda cost: cost.us)):
        for name, cost in costs.items():
            beside = () if name == plain else (plain, of(costs[plain]))
            yield known(f"GET of a script or style of the front page, {name}, {unit}", unit, of(cost), *beside)


def _cost(place: Scene, paths: Sequence[str], encodings: str, seconds: float, idle: float) -> Cost:
    with contextlib.closing(Client(place.place.root, encodings=encodings, accepted=("text/turtle, */*;q=0.1",))) as one:
        sizes = [len(one.ask("GET", path)[1]) for path in paths]  # each is read once before it is measured
        chance, count = random.Random(1), 0  # noqa: S311
        cpu, begin = cpu_s(place.pid), time.monotonic()
        while time.monotonic() < begin + seconds:
            status, _ = one.ask("GET", chance.choice(paths))
            assert status == 200
            count += 1
        spent_s = cpu_s(place.pid) - cpu - idle * (time.monotonic() - begin)
    return Cost(sum(sizes) / len(sizes), max(0.0, spent_s) * 1e6 / count)


def _idle(place: Scene, seconds: float) -> float:
    """Return the share of a processor that the frames of the robots take."""
    cpu, begin = cpu_s(place.pid), time.monotonic()
    time.sleep(seconds)
    return (cpu_s(place.pid) - cpu) / (time.monotonic() - begin)
