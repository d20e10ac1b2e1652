"""What a GET costs: requests that a gateway answers for each second of its processor's time, with robots at 100 Hz."""

import contextlib
import re
import shutil
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import httpx

from actor import Actor
from bench.beside import BARE, bare
from bench.scene import browsing, cpu_s, scene
from bench.table import Row, UnavailableError, at_least, known
from small_fleet import live

ROBOTS, RATE_HZ, CONNECTIONS = 5, 100, 32
_FRESH = Path(__file__).with_name("fresh.lua")
_TURTLE = "text/turtle"
_FULL = "application/xhtml+xml;q=0.3, application/ld+json;q=0.8, text/turtle;q=0.9, */*;q=0.1"


@dataclass(frozen=True)
class Asked:
    """Answers in ``seconds``, for which the server's processes had ``cpu_s``."""

    answers: int
    seconds: float
    cpu_s: float

    @property
    def per_cpu_s(self) -> float:
        return self.answers / self.cpu_s


def rows(seconds: float) -> list[Row]:
    with scene("--requests-per-client", "0") as place, contextlib.ExitStack() as robots:
        for number in range(ROBOTS):
            robots.enter_context(place.robot(f"mover{number}", RATE_HZ))
        Actor(place.session, "still").appear().stand(0.25)
        with browsing(place.place) as browser:
            live(browser, "still")
        root = place.place.root
        moving, resting = f"{root}mover0/elbow/rotation", f"{root}still/elbow/rotation"
        answer = httpx.get(resting, headers={"accept": _TURTLE}).raise_for_status()
        with bare(len(answer.content)) as (url, pid):
            constant = wrk(url, pid, seconds)
            unchanged = wrk(f"{url}unchanged", pid, seconds, status=304)
        found = {
            "a moving value as Turtle": wrk(moving, place.pid, seconds, {"accept": _TURTLE}),
            "a moving value, negotiated among five types": wrk(moving, place.pid, seconds, {"accept": _FULL}),
            "a moving value as JSON-LD": wrk(moving, place.pid, seconds, {"accept": "application/ld+json"}),
        }
        fresh = wrk(moving, place.pid, seconds, {"accept": _TURTLE}, fresh=True)
        match = {"accept": _TURTLE, "if-none-match": answer.headers["etag"]}
        same = wrk(resting, place.pid, seconds, match, status=304)
    beside = f"{BARE}, {len(answer.content)} constant bytes"
    unit = "1/CPU s"
    return [
        known(f"GET: {beside}", unit, constant.per_cpu_s),
        *(
            at_least(f"GET of {name}", unit, one.per_cpu_s, beside, constant.per_cpu_s, 0.8)
            for name, one in found.items()
        ),
        known("GET of a moving value, in other words each time", unit, fresh.per_cpu_s, beside, constant.per_cpu_s),
        at_least("GET answered 304", unit, same.per_cpu_s, f"{BARE}, 304", unchanged.per_cpu_s, 0.9),
    ]


def wrk(
    url: str, pid: int, seconds: float, fields: Mapping[str, str] | None = None, status: int = 200, fresh: bool = False
) -> Asked:
    """Ask on 32 connections as fast as answers come, ``fresh``: in other words each time. Each has ``status``."""
    if shutil.which("wrk") is None:
        raise UnavailableError("wrk is not here, with which requests are made: apt install wrk")
    flags = [word for name, value in (fields or {}).items() for word in ("-H", f"{name}: {value}")]
    assert httpx.get(url, headers=dict(fields or {})).status_code == status
    cpu, begin = cpu_s(pid), time.monotonic()
    flags += ["--script", str(_FRESH)] if fresh else []
    command = ("wrk", "-t1", f"-c{CONNECTIONS}", f"-d{max(1, round(seconds))}s", *flags, url)
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout  # noqa: S603
    cpu, took = cpu_s(pid) - cpu, time.monotonic() - begin
    assert "Non-2xx or 3xx" not in said and "Socket errors" not in said, said
    count = re.search(r"(\d+) requests in", said)
    assert count is not None, said
    return Asked(int(count[1]), took, cpu)
