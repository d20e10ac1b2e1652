"""Hostile sessions on the Zenoh network of a running gateway and a running agent: every key, in both directions.

Questions of the gateway are answered as wrongly as messages are published. Payloads come from ``fuzz.wire``; here they
also pass threads, inboxes and timeouts.
"""

import contextlib
import itertools
import json
import re
import threading
import time
from collections.abc import Callable
from random import Random

import httpx
import zenoh

from browser import Browser
from fake_robots import KEYS
from fuzzing import good, mutation
from fuzzing.findings import Tally, random_of
from fuzzing.living import PATIENCE_S, LiveGateway, in_batches, living
from fuzzing.wire import spoilt, spoilt_description, torn
from linked_fleet_agent.wire.codec import WireError, decode_reply, encode
from linked_fleet_agent.wire.messages import Description
from linked_fleet_gateway.resources.paths import robot_path
from running import process
from small_fleet import live

_NAMES = ("liar", "liar 2", "é", "pose")
_KINDS = (
    "state",
    "progress",
    "description",
    "command",
    "stop",
    "mesh",
    "presence/1",
    "presence/x",
    "presence",
    "x",
    "",
)
_LARGEST = 9_100_000
_ROBOT = "ur5"
_FRAME_BYTES = 40 + 8 * 3 * 6


def run(count: int, seed: int, first: int = 0) -> Tally:
    with (
        living() as there,
        process("-m", "linked_fleet_agent", f"--robot={_ROBOT}", "--connect", there.place.zenoh) as agent,
    ):
        with contextlib.closing(Browser(there.place.root)) as browser:
            live(browser, _ROBOT)
        there.watched.append(("the agent", agent))
        liars = LyingAgents(there)
        return in_batches("robots", count, seed, first, there, liars.send)


class LyingAgents:
    """Publishes a batch, asks the agent as many questions, and checks that both sides still work."""

    def __init__(self, there: LiveGateway) -> None:
        self._there, self._session = there, there.session
        self._answer = b""
        self._runs = itertools.count(1)
        self._asked = threading.Semaphore(0)
        self._frames = 0
        self._kept = [
            self._lie(name, kind) for name in _NAMES for kind in ("description", "command", "stop", "mesh", "picture")
        ]
        self._kept.append(self._session.declare_subscriber(KEYS.robot(_ROBOT, "state"), self._count))

    def send(self, tally: Tally, batch: range) -> None:
        for number in batch:
            random = random_of(tally.seed, number)
            try:
                wrong = random.choices(_WAYS, _WEIGHTS)[0](self, random)
            except (WireError, AssertionError, httpx.HTTPError) as error:
                wrong = f"{type(error).__name__}: {error}"[:200]
            if wrong:
                tally.found(wrong, number, 1, "")
        frames, deadline = self._frames, time.monotonic() + PATIENCE_S
        while self._frames == frames and time.monotonic() < deadline:
            time.sleep(0.01)
        if self._frames == frames:
            tally.found("the agent sends no frames any more", batch.start, len(batch), "")

    # What is published

    def publish(self, random: Random) -> str:
        name = random.choice((*_NAMES, "arm", "toy", _ROBOT))
        kind = random.choice(("state", "state", "progress", "progress", random.choice(_KINDS)))
        self._session.put(self._key(random, name, kind), self._payload(random, kind))
        return ""

    def presence(self, random: Random) -> str:
        """Declare a token, for which the gateway requests a description; some stay, like those of a hanging process."""
        name, run_ = random.choice(_NAMES), random.choice((next(self._runs), 0, 2**63 - 1, 2**63, 10**19 - 1))
        said = good.tree_of(good.description(random, name, run_ % 2**63))
        self._answer = spoilt_description(random, said) if random.random() < 0.7 else json.dumps(said).encode()
        token = self._session.liveliness().declare_token(KEYS.presence(name, run_))
        if random.random() < 0.8:
            self._asked.acquire(timeout=0.05)
        token.undeclare()
        return ""

    def other_tokens(self, random: Random) -> str:
        """Declare tokens of false gateways and invalid names."""
        names = ("x", "~41", "é", "a/b", random.choice(mutation.TEXTS[12:40]))
        key = random.choice((f"fleet/gateway/{random.choice(names)}", f"fleet/robot/{random.choice(names)}/presence/1"))
        with contextlib.suppress(zenoh.ZError, UnicodeEncodeError):
            self._session.liveliness().declare_token(key).undeclare()
        return ""

    # What is asked of the agent

    def ask(self, random: Random) -> str:
        kind = random.choice(("command", "command", "stop", "mesh", "description"))
        made = good.command if kind == "command" else None
        document = made(random, "a-1", 1, 1) if made else good.stop(random, "a-1")
        payload = spoilt(random, document) if random.random() < 0.98 else b"x" * random.choice((70_000, 2_000_000))
        if kind in ("mesh", "description"):
            payload = mutation.raw(random, b"0" * 64)
        attachment = random.choice(
            (None, b"", b"x" * 300, mutation.raw(random, b"00-" + b"a" * 32 + b"-" + b"b" * 16 + b"-01"))
        )
        answers = list(
            self._session.get(KEYS.robot(_ROBOT, kind), payload=payload, attachment=attachment, timeout=PATIENCE_S)  # type: ignore[arg-type]
        )
        if not answers:
            return f"the agent does not answer a {kind}"
        if kind in ("command", "stop"):
            assert answers[0].ok is not None, "an agent refuses in a reply"
            decode_reply(answers[0].ok.payload.to_bytes())
        return ""

    # What the gateway asks of a liar

    def lie(self, random: Random) -> str:
        """Let the gateway command a lying robot; the status for its client must be a documented one."""
        name = random.choice(_NAMES)
        self._answer = spoilt(random, good.reply(random, random.choice(("a-1", ""))))
        run_ = next(self._runs)
        path = f"{self._there.place.root.rstrip('/')}{robot_path(name)}actions/stop"
        honest = encode(_honest(name, run_))
        self._answer, spoilt_answer = honest, self._answer
        token = self._session.liveliness().declare_token(KEYS.presence(name, run_))
        self._asked.acquire(timeout=1.0)
        self._answer = spoilt_answer
        answer = httpx.post(path, timeout=PATIENCE_S)
        token.undeclare()
        return f"a stop is answered with {answer.status_code}" if answer.status_code in (500, 502) else ""

    def _lie(self, name: str, kind: str) -> object:
        key = KEYS.robot(name, kind)  # type: ignore[arg-type]

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(key, self._answer)
            self._asked.release()

        return self._session.declare_queryable(key, answer)

    def _key(self, random: Random, name: str, kind: str) -> str:
        key = KEYS.robot(name, "state").removesuffix("state") + kind
        if random.random() < 0.05:
            key += random.choice(("x", "/x", "/0", "/1/2", "/9" * 400))
        return re.sub("/+", "/", key).rstrip("/")  # Zenoh itself accepts no other form

    def _payload(self, random: Random, kind: str) -> bytes:
        if random.random() < 0.002:
            return b"x" * random.choice((65_536, 65_537, _LARGEST))
        if kind == "state":
            return torn(
                random,
                good.frame(random, random.choice((1, 4)), False, random.choice((1, 2, 3)), random.getrandbits(40)),
            )
        if kind == "progress":
            return spoilt(random, good.progress(random, "a-1", 1))
        return mutation.raw(random, b'{"version": 1}')

    def _count(self, sample: zenoh.Sample) -> None:
        if len(sample.payload) == _FRAME_BYTES:  # sent by the agent itself
            self._frames += 1


def _honest(name: str, run_: int) -> Description:
    return good.description(Random(run_), name, run_)


Way = Callable[[LyingAgents, Random], str]
_WAYS: tuple[Way, ...] = (
    LyingAgents.publish,
    LyingAgents.presence,
    LyingAgents.other_tokens,
    LyingAgents.ask,
    LyingAgents.lie,
)
_WEIGHTS = (66, 5, 2, 26, 1)
