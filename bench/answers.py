"""The cost of a GET: responses per second of the gateway's processor time.

Requests vary as those of browsers and crawlers do: each is for a random resource of five simulated robots, in Turtle or
JSON-LD, with the fields of a browser in random order and its own trace id. The bare server gets the same requests, and
answers each with a constant body and fields, as long as those of the median response of the gateway.
"""

import contextlib
import os
import re
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import httpx
from pyoxigraph import NamedNode, RdfFormat, parse

from bench.beside import BARE, Constant, bare
from bench.scene import Scene, cpu_s, scene, scene_of_robots
from bench.synthetic import urdf
from bench.table import Row, UnavailableError, at_least, at_most, known
from browser import HYBRIT, LF
from fake_robots import FakeRobot
from running import eventually

CONNECTIONS = 32
_BROWSER, _POSTS = Path(__file__).with_name("browser.lua"), Path(__file__).with_name("posts.lua")
_RDF_TYPE = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
_VALUE = "http://www.w3.org/ns/sosa/ObservableProperty"
_OTHERS = frozenset(
    [
        *(str(HYBRIT[name]) for name in ("Action", "RoboticThing")),
        str(LF.Blueprint),
        "http://www.w3.org/ns/shacl#NodeShape",
    ]
)
MEDIA_TYPES = ("text/turtle", "application/ld+json")
_WALKED = 4500
_SAMPLED = 50
_JOINTS, _CHANGES = 60, 9
_BY_SERVER = ("date", "server", "content-length", "connection")


@dataclass(frozen=True)
class Asked:
    """Responses in ``seconds``, which took ``cpu_s`` of the server's processes."""

    answers: int
    seconds: float
    cpu_s: float

    @property
    def per_cpu_s(self) -> float:
        return self.answers / self.cpu_s


def rows(seconds: float) -> list[Row]:
    with (
        scene_of_robots("--requests-per-client", "0") as (place, _),
        tempfile.TemporaryDirectory() as folder,
    ):
        root = place.place.root
        values, others, first_s, first_cpu_s = _walk(root, place.pid)
        again_s = read_all(root, [*values, *others], "application/n-triples")
        for media_type in MEDIA_TYPES:
            read_all(root, [*values, *others], media_type)
        asked: dict[str, list[tuple[str, ...]]] = {
            "/value": [(path,) for path in values],
            "/other": [(path,) for path in others],
            "/unchanged": [(path, *_tags(root, path)) for path in others[::20]],
        }
        typical = {name: typical_response(root, lines) for name, lines in asked.items()}
        ours, theirs = dict[str, float](), dict[str, float]()
        with bare(1, typical) as (url, pid):
            for name, lines in asked.items():
                fixed = [(name, *line[1:]) for line in lines]
                theirs[name] = browse(url, pid, seconds, listed(folder, "bare", fixed)).per_cpu_s
                ours[name] = browse(root, place.pid, seconds, listed(folder, "paths", lines)).per_cpu_s
        changed_ms, unchanged_ms = _changed(place)
    refused = _refused(seconds, [*values, *others])
    unit, walked = "1/CPU s", f"{_WALKED:,} resources read for the first time by one client"
    changed = f"first GET of a robot of {_JOINTS} joints after its description changed, p50"
    found = [
        at_most(walked, first_s * 1e3, "again", again_s * 1e3, 2000),
        known(f"{walked}: processor of the gateway", "ms", first_cpu_s * 1e3),
        at_most(changed, changed_ms, "again", unchanged_ms, 20),
    ]
    for name, what, goal in (
        ("/value", "GET of a random live value, read before", 0.6),
        ("/other", "GET of a random joint, link, robot, action or blueprint, read before", 0.35),
        ("/unchanged", "GET answered 304", 0.6),
    ):
        size = sum(len(key) + len(value) for key, value in typical[name].fields.items())
        beside = f"{BARE}, {typical[name].size:,} constant bytes and {size:,} of fields"
        found += [known(f"{what}: {BARE}", unit, theirs[name])]
        found += [at_least(what, unit, ours[name], beside, theirs[name], goal)]
    for what, rate, goal in (("GET of a random resource", refused[0], 1.0), ("POST of a motion", refused[1], 1.0)):
        found += [at_least(f"{what}, refused by rate", unit, rate, "GET of a value", ours["/value"], goal)]
    return found


def _refused(seconds: float, paths: Sequence[str]) -> tuple[float, float]:
    """Return the refusals per second of processor of a client far above its rate: of GETs, and of POSTs with a body."""
    with tempfile.TemporaryDirectory() as folder, scene("--requests-per-client", "1") as place:
        root, pid = place.place.root, place.pid
        gets = browse(root, pid, seconds, listed(folder, "all", [(path,) for path in paths]), refused=True).per_cpu_s
        posts = wrk(root, pid, seconds, flags=("--script", str(_POSTS)), refused=True).per_cpu_s
    return gets, posts


def _changed(place: Scene) -> tuple[float, float]:
    """Return the median times in ms of the first GET of a robot after its description changed, and of the next one."""
    first, again = list[float](), list[float]()
    joints = tuple(f"joint_{number}" for number in range(_JOINTS))
    with contextlib.closing(_connected(place.place.root)) as http:
        for model in range(_CHANGES):
            run = FakeRobot(place.session, "changing")
            run.appear(run.description(urdf(_JOINTS, model), joints))
            eventually(partial(_is_listed, http, f"synthetic-{model}"), f"model {model} of the robot")
            for media_type in MEDIA_TYPES:
                for took in (first, again):
                    begin = time.perf_counter()
                    _read(http, "/changing/", media_type)
                    took.append((time.perf_counter() - begin) * 1e3)
            run.leave()
    return statistics.median(first), statistics.median(again)


def _is_listed(http: HTTPConnection, model: str) -> bool:
    return f'"{model}"'.encode() in _read(http, "/", "text/turtle")[1]


def typical_response(root: str, lines: Sequence[tuple[str, ...]]) -> Constant:
    """Return the response of median length among those to fifty of the requests."""
    found = []
    with httpx.Client(base_url=root, headers={"accept-encoding": "gzip, deflate, br, zstd"}, timeout=60) as http:
        for path, *tags in lines[:: max(1, len(lines) // _SAMPLED)]:
            for media_type, tag in zip(MEDIA_TYPES, tags or ("", ""), strict=True):
                headers = {"accept": media_type} | ({"if-none-match": tag} if tag else {})
                answer = http.get(path, headers=headers)
                fields = {name: value for name, value in answer.headers.items() if name not in _BY_SERVER}
                found.append(Constant(answer.status_code, fields, int(answer.headers.get("content-length", "0"))))
    found.sort(key=lambda each: each.size + sum(map(len, each.fields.values())))
    return found[len(found) // 2]


def _walk(root: str, pid: int) -> tuple[list[str], list[str], float, float]:
    """Follow all links; return paths of measured values, other paths, and seconds for the first ``_WALKED``.

    The seconds are those of the clock, and of the processor in the gateway.
    """
    values, others, pending, seen = list[str](), list[str](), [root], {root}
    begin, cpu, walked_s, walked_cpu_s, count = time.monotonic(), cpu_s(pid), 0.0, 0.0, 0
    with contextlib.closing(_connected(root)) as http:
        while pending:
            iri = pending.pop()
            media_type, content = _read(http, urlsplit(iri).path, "application/n-triples")
            if not media_type.startswith("application/n-triples"):
                continue
            count += 1
            if count == _WALKED:
                walked_s, walked_cpu_s = time.monotonic() - begin, cpu_s(pid) - cpu
            types = set()
            for triple in parse(content, RdfFormat.N_TRIPLES):
                for term in (triple.subject, triple.object):
                    if isinstance(term, NamedNode) and term.value not in seen and _is_walked(term.value, root):
                        seen.add(term.value)
                        pending.append(term.value)
                if triple.predicate == _RDF_TYPE and triple.subject == NamedNode(iri):
                    types.add(triple.object.value)
            path = urlsplit(iri).path
            if _VALUE in types:
                values.append(path)
            elif types & _OTHERS:
                others.append(path)
    return values, others, walked_s, walked_cpu_s


def _is_walked(iri: str, root: str) -> bool:
    """Return False for recordings: their number depends on how long the gateway has run."""
    return iri.startswith(root) and "#" not in iri and "/history" not in iri


def read_all(root: str, paths: list[str], media_type: str) -> float:
    """Read each path once; return the time in seconds, scaled to the number of resources that were walked."""
    begin = time.monotonic()
    with contextlib.closing(_connected(root)) as http:
        for path in paths:
            assert _read(http, path, media_type)[0].startswith(media_type), path
    return (time.monotonic() - begin) / len(paths) * _WALKED


def _connected(root: str) -> HTTPConnection:
    return HTTPConnection(urlsplit(root).netloc, timeout=60)


def _read(http: HTTPConnection, path: str, media_type: str) -> tuple[str, bytes]:
    """Return media type and content. The client of the standard library takes a fifth of the time of httpx."""
    http.request("GET", path, headers={"accept": media_type})
    answer = http.getresponse()
    return answer.headers.get_content_type(), answer.read()


def _tags(root: str, path: str) -> Iterator[str]:
    for media_type in MEDIA_TYPES:
        headers = {"accept": media_type, "accept-encoding": "gzip"}
        yield httpx.get(root.rstrip("/") + path, headers=headers).raise_for_status().headers["etag"]


def listed(folder: str, name: str, lines: Sequence[tuple[str, ...]]) -> Path:
    path = Path(folder, name)
    path.write_text("".join(" ".join(line) + "\n" for line in lines))
    return path


def browse(url: str, pid: int, seconds: float, paths: Path, *, refused: bool = False) -> Asked:
    """Request the paths in the file with browser fields, on 32 connections as fast as responses come."""
    environment = {"PATHS": str(paths)}
    return wrk(url, pid, seconds, flags=("--script", str(_BROWSER)), environment=environment, refused=refused)


def wrk(
    url: str,
    pid: int,
    seconds: float,
    fields: Mapping[str, str] | None = None,
    status: int = 200,
    flags: tuple[str, ...] = (),
    environment: Mapping[str, str] | None = None,
    *,
    refused: bool = False,
) -> Asked:
    """Send requests on 32 connections as fast as responses come; statuses must be below 400, the first ``status``.

    ``refused``: nearly all must be refused instead.
    """
    if shutil.which("wrk") is None:
        raise UnavailableError("wrk is not here, with which requests are made: apt install wrk")
    words = [word for name, value in (fields or {}).items() for word in ("-H", f"{name}: {value}")]
    if not flags:
        assert httpx.get(url, headers=dict(fields or {})).status_code == status
    cpu, begin = cpu_s(pid), time.monotonic()
    command = ("wrk", "-t1", f"-c{CONNECTIONS}", f"-d{max(1, round(seconds))}s", *words, *flags, url)
    done = subprocess.run(  # noqa: S603
        command, capture_output=True, text=True, check=True, env={**os.environ, **(environment or {})}
    )
    cpu, took = cpu_s(pid) - cpu, time.monotonic() - begin
    said = done.stdout
    count, failed = re.search(r"(\d+) requests in", said), re.search(r"Non-2xx or 3xx responses: (\d+)", said)
    assert count is not None and "Socket errors" not in said, said
    assert (int(failed[1]) if failed else 0) >= int(count[1]) * 0.99 if refused else failed is None, said
    return Asked(int(count[1]), took, cpu)
