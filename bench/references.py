"""Minimal processes as references for the gateway.

``python -m bench.references bare PORT SIZE [ANSWERS]`` is Starlette with constant responses: one of so many bytes, and
those of the JSON object ANSWERS, which has status, header fields and number of bytes by path. ``robot ENDPOINT RATE``
sends states on Zenoh and answers questions; further arguments are authority, certificate and key of a tls or quic link.
"""

import contextlib
import json
import struct
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence

import uvicorn
import zenoh
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from linked_fleet_agent.wire.trust import Credentials
from linked_fleet_link.zenoh_session import settings

STATE, QUESTION = "raw/state", "raw/question"
SENT = struct.Struct("<q")
"""Header of a payload: its time of sending, CLOCK_MONOTONIC, ns."""
_FRAME = 480
"""Bytes of a state of twenty joints."""


class Beat:
    """Calls a function so many times a second in a thread of its own, from now on."""

    def __init__(self, rate_hz: float, act: Callable[[], None]) -> None:
        self._rate_hz, self._act, self._ended = rate_hz, act, threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        begin, number = time.monotonic(), 0
        while not self._ended.wait(max(0.0, begin + number / self._rate_hz - time.monotonic())):
            self._act()
            number += 1

    def close(self) -> None:
        self._ended.set()
        self._thread.join()


def session(mode: str, listen: str = "", connect: str = "", trust: Sequence[str] = ()) -> zenoh.Session:
    """Open a session like those of agents and gateways. ``trust``: files of authority, certificate and key."""
    values: dict[str, object] = {
        "mode": mode,
        "listen/endpoints": [listen] if listen else [],
        "connect/endpoints": [connect] if connect else [],
        "connect/timeout_ms": -1,
        "connect/retry": {"period_init_ms": 20, "period_max_ms": 200, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }
    if trust:
        values |= Credentials(*trust).configuration()
    return _opened(values)


def session_of_gateway(connect: str) -> zenoh.Session:
    """Open a session configured exactly as a gateway's."""
    return _opened(settings((), (connect,), {}))


def _opened(values: Mapping[str, object]) -> zenoh.Session:
    config = zenoh.Config()
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


# -- the processes ----------------------------------------------------------------------------------------------------


def bare(port: str, size: str, answers: str = "{}") -> None:
    body = b"x" * int(size)

    async def read(_: Request) -> Response:
        return Response(body, media_type="text/turtle")

    async def take(request: Request) -> Response:
        await request.body()
        return Response(status_code=204)

    routes = [Route("/", read), Route("/", take, methods=["POST"])]
    routes += [Route(path, _constant(*answer)) for path, answer in json.loads(answers).items()]
    app = Starlette(routes=routes)
    uvicorn.run(app, port=int(port), loop="uvloop", http="httptools", access_log=False)


def _constant(status: int, fields: dict[str, str], size: int) -> Callable[[Request], Awaitable[Response]]:
    body = b"x" * size

    async def answer(_: Request) -> Response:
        return Response(body, status, fields)

    return answer


def robot(endpoint: str, rate_hz: str, *trust: str) -> None:
    """Send states as often as an agent, and answer each question.

    States are sent as unreliable, where the link supports that: the next one follows soon.
    """
    with session("client", connect=endpoint, trust=trust) as there:
        there.declare_queryable(
            QUESTION, zenoh.handlers.Callback(lambda query: query.reply(QUESTION, b"yes"), indirect=False)
        )
        publisher = there.declare_publisher(
            STATE,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA,
            express=False,
            reliability=zenoh.Reliability.BEST_EFFORT,
        )

        def say() -> None:
            publisher.put(SENT.pack(time.monotonic_ns()) + bytes(_FRAME - SENT.size))

        with contextlib.closing(Beat(float(rate_hz), say)):
            print("ready", flush=True)
            sys.stdin.read()


if __name__ == "__main__":
    what, *words = sys.argv[1:]
    if what == "bare":
        bare(*words)
    else:
        robot(*words)
