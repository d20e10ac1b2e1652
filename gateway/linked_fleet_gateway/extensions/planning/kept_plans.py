"""Rehearsed motions that are kept for a while, shared by all gateways: the next request takes the very same path."""

import secrets
import time
from collections.abc import Iterator
from hashlib import blake2b
from typing import NamedTuple

import msgspec
from pyoxigraph import BlankNode, NamedNode

from linked_fleet_agent.wire.messages import Expectation, Follow, Move
from linked_fleet_gateway.api import ActionRequest, Body, Motion, Pose
from linked_fleet_gateway.extensions.planning.terms import LF
from linked_fleet_gateway.serving import RedisConnection
from linked_fleet_rdf.vocabulary import RDF
from linked_fleet_state.kept_plan import KeptPlan

KEPT_S = 60
"""Lifetime of a kept plan, in seconds."""
MOST_PLANS, MOST_OF_ONE = 256, 8
"""Plans of all clients, after which none is kept, and of one client, whose oldest one is then forgotten."""
MOST_BYTES = 192 * 1024
"""Size of one plan. The longest trajectory that a command takes has 150 kB."""
_ID_BYTES = 16
_DEEPEST = 8
"""Blank nodes between the root of a body and what its digest covers; shapes of actions go half as deep."""

# KEYS: plans, times at which they are forgotten, and those of the client. ARGV: id, plan, seconds, most of the client,
# most of all. The clock is that of Redis, so that gateways need not agree about the time.
_KEEP = """
local time = redis.call('TIME')
local now = time[1] * 1000000 + time[2]
for _, id in ipairs(redis.call('ZRANGEBYSCORE', KEYS[2], '-inf', now)) do redis.call('HDEL', KEYS[1], id) end
for _, key in ipairs({KEYS[2], KEYS[3]}) do redis.call('ZREMRANGEBYSCORE', key, '-inf', now) end
while redis.call('ZCARD', KEYS[3]) >= tonumber(ARGV[4]) do
  local oldest = redis.call('ZPOPMIN', KEYS[3])[1]
  redis.call('ZREM', KEYS[2], oldest)
  redis.call('HDEL', KEYS[1], oldest)
end
if redis.call('ZCARD', KEYS[2]) >= tonumber(ARGV[5]) then return 0 end
redis.call('HSET', KEYS[1], ARGV[1], ARGV[2])
for _, key in ipairs({KEYS[2], KEYS[3]}) do redis.call('ZADD', key, now + ARGV[3] * 1000000, ARGV[1]) end
for _, key in ipairs(KEYS) do redis.call('EXPIRE', key, 2 * ARGV[3]) end
return 1
"""
_FIND = """
local until_us = redis.call('ZSCORE', KEYS[2], ARGV[1])
if not until_us then return nil end
local time = redis.call('TIME')
local left = tonumber(until_us) / 1000000 - time[1] - time[2] / 1000000
if left <= 0 then return nil end
return {redis.call('HGET', KEYS[1], ARGV[1]), math.ceil(left)}
"""


class Plan(msgspec.Struct, frozen=True):
    """A rehearsed motion. ``request`` is the digest of what was asked for; ``client`` may use it.

    ``stands`` are the positions of the joints that move or carry those that do, and ``base`` is the pose of the root in
    the world.
    """

    client: str
    request: str
    motion: Move | Follow
    targets: dict[str, float]
    stands: dict[str, float]
    base: Pose
    speed_scale: float
    expectations: dict[str, Expectation]
    facts: dict[str, float]
    detour: str


class Found(NamedTuple):
    """A plan that is kept for ``left_s`` more seconds."""

    plan: Plan
    left_s: int


class KeptPlans:
    """The plans of all gateways. They must be closed. All methods raise RedisUnavailable."""

    def __init__(self, url: str, namespace: str) -> None:
        # One hash tag, so that a plan and its time are kept at once in a cluster too.
        self._keys = f"{namespace}:planning:{{@planning}}"
        self._redis = RedisConnection(url, f"{self._keys}:news")

    async def close(self) -> None:
        await self._redis.close()

    async def keep(self, plan: Plan) -> KeptPlan | None:
        """Keep a plan; None if there is no room for it."""
        id, written = secrets.token_urlsafe(_ID_BYTES), msgspec.msgpack.encode(plan)
        if len(written) > MOST_BYTES:
            return None
        until_ns = time.time_ns() + KEPT_S * 10**9
        own = f"{self._keys}:of:{blake2b(plan.client.encode(), digest_size=16).hexdigest()}"
        keys = (f"{self._keys}:plans", f"{self._keys}:until", own)
        is_kept = await self._redis.run_script(_KEEP, keys, id, written, KEPT_S, MOST_OF_ONE, MOST_PLANS)
        return KeptPlan(id, until_ns) if is_kept else None

    async def find(self, id: str) -> Found | None:
        """Return a plan; None if it is kept no longer, or cannot be read by this gateway."""
        found = await self._redis.run_script(_FIND, (f"{self._keys}:plans", f"{self._keys}:until"), id)
        if found is None or found[0] is None:
            return None
        try:
            return Found(msgspec.msgpack.decode(found[0], type=Plan), found[1])
        except msgspec.ValidationError:  # of a gateway of another version
            return None


def plan_of(motion: Motion) -> str | None:
    """Return the id of the plan that a request names."""
    body = None if motion.request is None else motion.request.body
    return None if body is None else body.text(body.root, LF.plan)


def digest_of(request: ActionRequest) -> str:
    """Return the fingerprint of a request without its plan, whatever the syntax and the names of its blank nodes."""
    joint = "" if request.joint is None else request.joint.name
    return f"{request.required_robot().name} {joint} {body_digest(request.body, request.base)}"


def body_digest(body: Body, base: str) -> str:
    return _Digests(body, base).of(body.root)


class _Digests:
    """Digests of the nodes of a body by what is said of them; each is computed once for each depth."""

    def __init__(self, body: Body, base: str) -> None:
        self._base = base
        self._said: dict[object, list[tuple[str, object]]] = {}
        for triple in dict.fromkeys(body.triples):
            if triple.predicate not in {LF.plan, RDF.type}:
                self._said.setdefault(triple.subject, []).append((triple.predicate.value, triple.object))
        self._known: dict[tuple[object, int], str] = {}

    def of(self, node: object, depth: int = 0) -> str:
        if (node, depth) not in self._known:
            said = "\n".join(sorted(self._lines(node, depth))) if depth < _DEEPEST else ""
            self._known[node, depth] = blake2b(said.encode(), digest_size=16).hexdigest()
        return self._known[node, depth]

    def _lines(self, node: object, depth: int) -> Iterator[str]:
        for predicate, value in self._said.get(node, ()):
            yield f"{predicate} {self.of(value, depth + 1) if isinstance(value, BlankNode) else self._term(value)}"

    def _term(self, value: object) -> str:
        return value.value.removeprefix(self._base) if isinstance(value, NamedNode) else str(value)
