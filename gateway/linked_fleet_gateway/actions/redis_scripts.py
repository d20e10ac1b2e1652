"""Keys and atomic steps of the store of actions in Redis.

Braces are hash tags of Redis Cluster: keys with the same tag share a slot, so that one script can access them. Each
robot has its own tag, so has the fleet as a whole, and one tag holds all settings.

They are short and sent as a whole each time, because a restarted server has no cached scripts. They use the server's
clock, so that the clocks of gateways need not agree. That clock may be set too, so nothing shorter than a day depends
on it.
"""

import hashlib
import re
from dataclasses import dataclass

from linked_fleet_agent.wire.keys import escape, unescape
from linked_fleet_state.invocations import FLEET

_NAMESPACE = re.compile(r"[A-Za-z0-9_./-]+")
_FLEET_TAG = "@fleet"  # no robot has it, because escaped names do not contain this sign
_SETTINGS_TAG = "@settings"


def robot_tag(robot: str) -> str:
    """Return the part of a key for a robot or the fleet. Raises ValueError for an invalid name."""
    return _FLEET_TAG if robot == FLEET else escape(robot)


def robot_from_tag(tag: str) -> str:
    """Invert ``tag``. Raises ValueError for other texts."""
    return FLEET if tag == _FLEET_TAG else unescape(tag)


@dataclass(frozen=True)
class Keys:
    """All keys under one namespace. Raises ValueError if the namespace would make them ambiguous."""

    namespace: str = "fleet"

    def __post_init__(self) -> None:
        if not _NAMESPACE.fullmatch(self.namespace):
            raise ValueError(f"namespace {self.namespace!r} is not a plain key such as 'fleet' or 'site/hall-2'")

    @property
    def robots(self) -> str:
        """Sorted set of the tags of robots with invocations, by the day of the last one."""
        return f"{self.namespace}:actions:robots"

    def invocations(self, robot: str) -> tuple[str, str, str]:
        """Return the keys of a robot's invocations.

        A hash by id, and sorted sets of ids by expiry (Unix ms) and, of those that are over, by creation (Unix µs).
        """
        begin = self._of(robot, "")
        return begin + "invocations", begin + "forgotten", begin + "over"

    def idempotency_key(self, robot: str, key: str) -> str:
        """Hash of the request that used an idempotency key, which may be any text."""
        return self._of(robot, f"key:{text_hash(key)}")

    def lease(self, robot: str) -> str:
        """Hash of the lease of a robot, which expires with the lease."""
        return self._of(robot, "lease")

    def settings(self, robot: str) -> str:
        """Hash of the settings of a robot by name."""
        return f"{self.namespace}:actions:{{{_SETTINGS_TAG}}}:{robot_tag(robot)}"

    @property
    def robots_with_settings(self) -> str:
        """Set of the tags of robots with settings."""
        return f"{self.namespace}:actions:{{{_SETTINGS_TAG}}}"

    @property
    def owed_stops(self) -> str:
        """Hash of the stops that agents have not confirmed, by tag of the robot and id of the stop."""
        return f"{self.namespace}:actions:owed"

    @property
    def news(self) -> str:
        """Stream of changes, for other gateways."""
        return f"{self.namespace}:actions:news"

    def _of(self, robot: str, part: str) -> str:
        return f"{self.namespace}:actions:{{{robot_tag(robot)}}}:{part}"


def text_hash(text: str) -> str:
    """Return a hash of any text; secrets and long texts are in Redis in this form only."""
    return hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()


_NOW = """
local time = redis.call('TIME')
local now = time[1] * 1000 + math.floor(time[2] / 1000)
"""

# KEYS begin with: invocations, forgotten, over. Expired invocations are deleted first. The keys themselves expire with
# their last entry, for robots that are never accessed again.
_INVOCATIONS = (
    _NOW
    + """
local function forget(id)
  redis.call('HDEL', KEYS[1], id)
  redis.call('ZREM', KEYS[2], id)
  redis.call('ZREM', KEYS[3], id)
end
local function write(id, body, kept_ms, over, created)
  redis.call('HSET', KEYS[1], id, body)
  redis.call('ZADD', KEYS[2], now + kept_ms, id)
  if over == '1' then redis.call('ZADD', KEYS[3], created, id) end
  local last = redis.call('ZREVRANGE', KEYS[2], 0, 0, 'WITHSCORES')[2]
  for index = 1, 3 do redis.call('PEXPIREAT', KEYS[index], last) end
end
for _, id in ipairs(redis.call('ZRANGEBYSCORE', KEYS[2], '-inf', now)) do forget(id) end
"""
)

# Beyond the number to keep, the oldest invocation that is over is deleted, or an open one if all are open.
_LIMIT = """
local function limit(number)
  while redis.call('HLEN', KEYS[1]) > tonumber(number) do
    forget(redis.call('ZRANGE', KEYS[3], 0, 0)[1] or redis.call('ZRANGE', KEYS[2], 0, 0)[1])
  end
end
"""

ANYBODY = "anybody"  # stands for a token and matches any lease

# Returns a lease as id, holder, time taken, expiry, duration and time left, in milliseconds, and priority; false
# without one.
# Gateways read each lease several times a second. The time since the last read counts as 2.5 s at most and never
# negative: a larger difference means that the clock was set, or that no gateway was present, and moves the expiry. If
# writing fails, a later read moves it.
_LEASE = (
    _NOW
    + """
local function settled(key)
  local seen, expires = unpack(redis.call('HMGET', key, 'seen_ms', 'expires_ms'))
  seen, expires = tonumber(seen) or now, tonumber(expires)
  local counted = math.min(math.max(now - seen, 0), 2500)
  if now - seen ~= counted then
    expires = expires + now - seen - counted
    redis.pcall('HSET', key, 'expires_ms', expires, 'seen_ms', now)
    redis.pcall('PEXPIREAT', key, expires + 86400000)
  elseif counted >= 500 then
    redis.pcall('HSET', key, 'seen_ms', now)
  end
  return expires - now
end
local function lease(key)
  if redis.call('EXISTS', key) == 0 then return false, {} end
  local left = settled(key)
  if left <= 0 then
    redis.pcall('DEL', key)
    return false, {}
  end
  local held = redis.call('HMGET', key, 'token', 'id', 'holder', 'taken_ms', 'expires_ms', 'duration_ms', 'priority')
  return held[1], {held[2], held[3], held[4], held[5], held[6], tostring(left), held[7] or 'program'}
end
local function refused(key, token, tied)
  local owner, held = lease(key)
  if token == 'anybody' then return end
  if owner and owner ~= token then return {'held', unpack(held)} end
  if tied ~= '' and held[1] ~= tied then return {'over'} end
end
"""
)

# KEYS: lease; ARGV: token, lease that the motion is tied to or nothing. Returns if the caller may act.
CHECK = (
    _LEASE
    + """
return refused(KEYS[1], ARGV[1], ARGV[2]) or {'free'}
"""
)

# KEYS: invocations, forgotten, over, lease, optionally idempotency key; ARGV: token, lease that it is tied to or
# nothing, id, body, milliseconds to keep it, 1 if it is over, creation, number to keep, 1 if the client has reached its
# limit, and with the key: digest of the request, milliseconds to keep the key. An existing id is the same request,
# repeated by the gateway.
OPEN = (
    _INVOCATIONS
    + _LIMIT
    + _LEASE
    + """
local refusal = refused(KEYS[4], ARGV[1], ARGV[2])
if refusal then return refusal end
if KEYS[5] then
  local id, digest = unpack(redis.call('HMGET', KEYS[5], 'id', 'digest'))
  if id and digest ~= ARGV[10] then return {'reused'} end
  if id and id ~= ARGV[3] then return {'repeated', id} end
end
if redis.call('HEXISTS', KEYS[1], ARGV[3]) == 1 then return {'opened'} end
if ARGV[9] == '1' then return {'full'} end
if KEYS[5] then
  redis.call('HSET', KEYS[5], 'id', ARGV[3], 'digest', ARGV[10])
  redis.call('PEXPIRE', KEYS[5], ARGV[11])
end
write(ARGV[3], ARGV[4], ARGV[5], ARGV[6], ARGV[7])
limit(ARGV[8])
return {'opened'}
"""
)

# KEYS: invocations, forgotten, over; ARGV: number to keep, then for each invocation: id, body, milliseconds to keep it,
# 1 if it is over for good, creation, 1 if it is new: opened unless it exists. Returns for each 1 if this body is stored
# now: the invocation is new, or it exists and was not over with another body.
SAVE = (
    _INVOCATIONS
    + _LIMIT
    + """
local saved = {}
for at = 2, #ARGV, 6 do
  local id, body, kept_ms, over, created, new = unpack(ARGV, at, at + 5)
  local stored = redis.call('HGET', KEYS[1], id)
  if not stored and new == '0' then
    saved[#saved + 1] = 0
  elseif stored and redis.call('ZSCORE', KEYS[3], id) then
    saved[#saved + 1] = stored == body and 1 or 0
  else
    write(id, body, kept_ms, over, created)
    if not stored then limit(ARGV[1]) end
    saved[#saved + 1] = 1
  end
end
return saved
"""
)

# KEYS: invocations, forgotten, over; ARGV: id. Returns 1 if it existed.
DELETE = (
    _INVOCATIONS
    + """
local there = redis.call('HEXISTS', KEYS[1], ARGV[1])
forget(ARGV[1])
return there
"""
)

# KEYS: invocations, forgotten, over; ARGV: id. Returns one body, or nothing.
READ = _INVOCATIONS + "return redis.call('HGET', KEYS[1], ARGV[1])"

# KEYS: invocations, forgotten, over. Returns all bodies.
LOAD = _INVOCATIONS + "return redis.call('HVALS', KEYS[1])"

# KEYS: robots; ARGV: robot, day. Removes a robot without invocations, unless a new one was announced since.
RETIRE = """
local day = redis.call('ZSCORE', KEYS[1], ARGV[1])
if day and tonumber(day) < tonumber(ARGV[2]) then redis.call('ZREM', KEYS[1], ARGV[1]) end
return 1
"""

# KEYS: lease; ARGV: token, id and token of a new lease, holder, milliseconds, priority or nothing. Returns the lease,
# taken or renewed. A person takes it from a program. A renewal without a priority keeps the one that the lease has.
TAKE = (
    _LEASE
    + """
local refusal = refused(KEYS[1], ARGV[1], '')
if refusal and not (ARGV[6] == 'person' and refusal[8] == 'program') then return refusal end
if refusal then redis.call('DEL', KEYS[1]) end
if redis.call('EXISTS', KEYS[1]) == 0 then
  redis.call('HSET', KEYS[1], 'id', ARGV[2], 'token', ARGV[3], 'holder', ARGV[4], 'taken_ms', now)
end
if ARGV[6] ~= '' then redis.call('HSET', KEYS[1], 'priority', ARGV[6]) end
redis.call('HSET', KEYS[1], 'duration_ms', ARGV[5], 'expires_ms', now + ARGV[5], 'seen_ms', now)
redis.call('PEXPIREAT', KEYS[1], now + ARGV[5] + 86400000)
local _, held = lease(KEYS[1])
return {'taken', unpack(held)}
"""
)

# KEYS: lease; ARGV: token, id and token of a new lease, holder, milliseconds, 1 if the new holder may have the priority
# of a person. Returns the lease, which has another holder from now on, or nothing if nobody has it.
HAND_OVER = (
    _LEASE
    + """
local refusal = refused(KEYS[1], ARGV[1], '')
if refusal then return refusal end
if not lease(KEYS[1]) then return {'free'} end
redis.call('HSET', KEYS[1], 'id', ARGV[2], 'token', ARGV[3], 'holder', ARGV[4], 'taken_ms', now)
redis.call('HSET', KEYS[1], 'duration_ms', ARGV[5], 'expires_ms', now + ARGV[5], 'seen_ms', now)
if ARGV[6] ~= '1' then redis.call('HDEL', KEYS[1], 'priority') end
redis.call('PEXPIREAT', KEYS[1], now + ARGV[5] + 86400000)
local _, held = lease(KEYS[1])
return {'taken', unpack(held)}
"""
)

# KEYS: lease; ARGV: token. Returns the released lease, or nothing.
RELEASE = (
    _LEASE
    + """
local refusal = refused(KEYS[1], ARGV[1], '')
if refusal then return refusal end
local owner, held = lease(KEYS[1])
if not owner then return {'free'} end
redis.call('DEL', KEYS[1])
return {'released', unpack(held)}
"""
)

# KEYS: lease. Returns the lease, or nothing.
HELD = (
    _LEASE
    + """
local owner, held = lease(KEYS[1])
return owner and {'held', unpack(held)} or {'free'}
"""
)

# KEYS: settings of the robot, configured; ARGV: robot, name, "=" and the expected value or nothing, optionally the new
# value. Returns 1 if the expected value was present.
SET = """
local present = redis.call('HGET', KEYS[1], ARGV[2])
if (present and '=' .. present or '') ~= ARGV[3] then return 0 end
if ARGV[4] then
  redis.call('HSET', KEYS[1], ARGV[2], ARGV[4])
  redis.call('SADD', KEYS[2], ARGV[1])
else
  redis.call('HDEL', KEYS[1], ARGV[2])
  if redis.call('EXISTS', KEYS[1]) == 0 then redis.call('SREM', KEYS[2], ARGV[1]) end
end
return 1
"""
