"""A real gateway with robots played by this process, and the invariants that hold whatever is sent."""

import contextlib
import itertools
import re
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import zenoh

from bench.scene import pid_of, rss_kib
from browser import Browser
from fake_robots import KEYS, FakeRobot, open_session
from fuzzing.findings import Tally
from fuzzing.good import able_arm
from fuzzing.stops import LATE_S, STOP, Stops, stopping
from fuzzing.watched import STALL
from linked_fleet_agent.wire.codec import WireError, decode, encode
from linked_fleet_agent.wire.messages import WIRE_VERSION, Accepted, Command, Progress, Refused, Stop
from running import Process, process
from small_fleet import Place, live

PATIENCE_S = 20.0
"""Limit for a response on a busy machine; what takes longer hangs."""
BATCH = 250
"""Inputs between two checks of the gateway."""
SETTINGS = ("--subscriptions-per-client", "40", "--callback-allow", "127.0.0.0/8")
_REPEATS = 3
_LEFT_OPEN = 60
"""Limit of additional file descriptors after the warm-up, for closed connections that have not been noticed yet."""
WRONG = re.compile(r"Traceback|\bERROR\b|\bCRITICAL\b|never retrieved|never awaited")
_BEGIN = re.compile(r"\d{4}-\d\d-\d\d ")
_IRI = re.compile(rb"<(http://[^<>\s]+)>")
_MOST_PATHS = 400


class LiveGateway:
    """The gateway and what has been observed of it."""

    def __init__(self, place: Place, gateway: Process, session: zenoh.Session, stops: Stops | None = None) -> None:
        self.place, self.gateway, self.session = place, gateway, session
        self.stops = stops
        self.stalls: list[str] = []
        """Return and clear the log lines about callbacks of the event loop that took too long."""
        self.port = place.port
        self.pid = pid_of(gateway)
        self.watched: list[tuple[str, Process]] = [("the gateway", gateway)]
        self._read: dict[str, int] = {}
        self._warm: dict[str, tuple[int, int]] = {}

    def probe(self) -> None:
        """Read the root in time; AssertionError otherwise."""
        try:
            answer = httpx.get(self.place.root, headers={"accept": "text/turtle"}, timeout=PATIENCE_S)
        except httpx.HTTPError as error:
            raise AssertionError(f"the gateway does not answer: {error!r}") from error
        assert answer.status_code == 200, f"the root is answered with {answer.status_code}"

    def paths(self) -> list[str]:
        """Return the paths of the tree, breadth first."""
        found, pending = {"/": None}, ["/"]
        with httpx.Client(base_url=self.place.root, timeout=PATIENCE_S) as http:
            while pending and len(found) < _MOST_PATHS:
                answer = http.get(pending.pop(0), headers={"accept": "text/turtle, */*;q=0.1"})
                for iri in _IRI.findall(answer.content):
                    parts = urlsplit(iri.decode())
                    if parts.port == self.port and parts.path not in found:
                        found[parts.path] = None
                        pending.append(parts.path)
        return list(found)

    def subscribe(self) -> str:
        """Create a callback subscription whose receiver does not exist, and return its id."""
        headers = {"connection": "upgrade", "upgrade": "callback", "callback": "http://127.0.0.1:9/"}
        answer = httpx.get(f"{self.place.root}arm/pan/rotation", headers=headers, timeout=PATIENCE_S)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"].rpartition("/")[2]

    def look(self, tally: Tally, first: int, count: int) -> bool:
        """Record faults of the processes after these inputs; return False if one of them has ended."""
        for who, each in self.watched:
            lines = each.lines[self._read.get(who, 0) :]
            self._read[who] = len(each.lines)
            for at in (at for at, line in enumerate(lines) if WRONG.search(line) and _BEGIN.match(line)):
                if STALL in lines[at]:
                    self.stalls.append(lines[at])
                    continue
                said = [lines[at], *itertools.takewhile(lambda line: not _BEGIN.match(line), lines[at + 1 :])]
                tally.found(f"log of {who}: {_cause(said)}", first, count, "".join(said)[-3500:])
            if not Path(f"/proc/{pid_of(each)}/fd").exists() or each._child.poll() is not None:
                tally.found(f"{who} has ended", first, count, each.output[-4000:])
                return False
        if self.stops is not None and (late_s := self.stops.late_s()):
            tally.found(f"a stop was answered after more than {LATE_S:g} s", first, count, f"after {late_s:.2f} s")
        try:
            self.probe()
        except AssertionError as error:
            tally.found(str(error)[:150], first, count, self.gateway.output[-2000:])
            return False
        return True

    def warm(self) -> None:
        """End the warm-up: from here on memory and descriptors may not grow."""
        self._warm = {who: (rss_kib(pid_of(each)), _open(pid_of(each))) for who, each in self.watched}

    def judge(self, tally: Tally) -> None:
        if self.stops is not None:
            tally.notes.append(self.stops.note())
        for who, each in self.watched:
            if who in self._warm and each._child.poll() is None:
                warm_kib, warm_open = self._warm[who]
                tally.grew(warm_kib, rss_kib(pid_of(each)), who)
                more = _settled(pid_of(each), warm_open + _LEFT_OPEN) - warm_open
                if more > _LEFT_OPEN:
                    tally.found(f"{who} keeps files open", 0, tally.inputs, f"{more} more than after the warm-up")


def _cause(said: Sequence[str]) -> str:
    """Return the exception of a traceback, else the logged text, without times and numbers."""
    told = said[-1] if len(said) > 1 else said[0].partition(" ")[2].partition(" ")[2]
    return re.sub(r"0x[0-9a-f]+|\d{3,}", "…", told.strip())[:150]


def _open(pid: int) -> int:
    return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())


def _settled(pid: int, most: int) -> int:
    """Return the number of open files, after waiting until there are at most ``most``."""
    deadline = time.monotonic() + PATIENCE_S
    while _open(pid) > most and time.monotonic() < deadline:
        time.sleep(0.1)
    return _open(pid)


@contextlib.contextmanager
def living() -> Iterator[LiveGateway]:
    """Run a gateway with an obedient and a silent robot."""
    with tempfile.TemporaryDirectory() as state:
        place = Place(Path(state))
        with process("-P", "tests/fuzzing/watched.py", *place.command()[2:], *SETTINGS) as gateway:
            gateway.said("serving")
            with open_session(place.zenoh) as session, contextlib.closing(Browser(place.root)) as browser:
                arm, toy = FakeRobot(session, "arm"), FakeRobot(session, "toy")
                obey(arm)
                arm.appear(encode(able_arm(arm.incarnation))).stand(0.1, 0.1, 0.1, 0.1)
                toy.appear().stand(0.2)
                for name in ("arm", "toy"):
                    live(browser, name)
                with stopping(place.root + STOP) as stops:
                    yield LiveGateway(place, gateway, session, stops)


def obey(actor: FakeRobot) -> None:
    """Accept every command, and reach its target at once."""

    def answer(kind: str, judge: Callable[[bytes], tuple[bytes, bytes | None]]) -> None:
        key = KEYS.robot(actor.name, kind)  # type: ignore[arg-type]

        def take(query: zenoh.Query) -> None:
            reply, then = judge(b"" if query.payload is None else query.payload.to_bytes())
            with query:
                query.reply(key, reply)
            if then is not None:
                actor.put("progress", then)

        actor.keep(actor.session.declare_queryable(key, take, complete=True))

    answer("command", _obeyed)
    answer("stop", _stopped)


def _obeyed(payload: bytes) -> tuple[bytes, bytes | None]:
    try:
        command = decode(payload, Command)
    except WireError as error:
        return encode(Refused("", "malformed", str(error)[:1024])), None
    end = Progress(
        version=WIRE_VERSION, id=command.id, incarnation=command.incarnation, state="succeeded", wall_ns=time.time_ns(),
        progress=1.0,
    )  # fmt: skip
    return encode(Accepted(id=command.id, at_ns=time.monotonic_ns())), None if command.rehearsal else encode(end)


def _stopped(payload: bytes) -> tuple[bytes, bytes | None]:
    try:
        return encode(Accepted(id=decode(payload, Stop).id, at_ns=time.monotonic_ns())), None
    except WireError as error:
        return encode(Refused("", "malformed", str(error)[:1024])), None


def in_batches(
    target: str, count: int, seed: int, first: int, there: LiveGateway, send: Callable[[Tally, range], None]
) -> Tally:
    """``send`` sends the inputs of a range, and records what it observes."""
    tally, started, end = Tally(target, seed), time.monotonic(), first + count
    for begin in range(first, end, BATCH):
        batch = range(begin, min(begin + BATCH, end))
        send(tally, batch)
        tally.inputs += len(batch)
        if not there.look(tally, batch.start, len(batch)) or not _again(tally, there, batch, send):
            break
        if begin <= first + count // 3 < begin + BATCH:
            there.warm()
    there.judge(tally)
    tally.seconds = time.monotonic() - started
    return tally


def _again(tally: Tally, there: LiveGateway, batch: range, send: Callable[[Tally, range], None]) -> bool:
    """Repeat a batch in which the loop stalled: it is a finding only if it stalls each time.

    Returns False if the gateway has ended.
    """
    for _ in range(_REPEATS):
        if not there.stalls:
            return True
        there.stalls.clear()
        send(tally, batch)
        if not there.look(tally, batch.start, len(batch)):
            return False
    if there.stalls:
        tally.found("the event loop stalled", batch.start, len(batch), "".join(there.stalls))
        there.stalls.clear()
    return True
