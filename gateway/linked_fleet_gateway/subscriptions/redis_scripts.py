"""Keys and atomic steps of the store of subscriptions in Redis.

Braces are the hash tags of Redis Cluster: keys with the same tag are in one slot, so that one script can use them
together. One tag holds which runs are alive and what each holds; each subscription has its own tag.

They are sent whole each time: they are short, and a restarted server knows no script by its digest.
"""

import re
from dataclasses import dataclass
from typing import Literal
from urllib.parse import quote, unquote

Kind = Literal["runs", "lease", "held", "record", "queue", "sent", "gone", "owner", "client", "news"]

_NAMESPACE = re.compile(r"[A-Za-z0-9_./-]+")
_KEY = re.compile(
    r"(?P<news>news)|\{(?P<runs>runs)\}|\{runs\}:(?P<run_kind>lease|held):(?P<run>.+)"
    r"|subscription:\{(?P<id>[^{}]+)\}(?::(?P<part>queue|sent|gone))?"
    r"|owner:(?P<owner>.+)|client:(?P<client>[^{}]*)",
    re.S,
)


@dataclass(frozen=True)
class Key:
    """A parsed key. ``name``: its run, id, path or address; empty if there is only one such key."""

    kind: Kind
    name: str = ""


@dataclass(frozen=True)
class Keys:
    """All keys under one namespace; ValueError if the namespace would make them ambiguous."""

    namespace: str = "fleet"

    def __post_init__(self) -> None:
        if not _NAMESPACE.fullmatch(self.namespace):
            raise ValueError(f"namespace {self.namespace!r} is not a plain key such as 'fleet' or 'site/hall-2'")

    @property
    def runs(self) -> str:
        """Set of the gateway runs that are alive or hold something."""
        return f"{self.namespace}:{{runs}}"

    def lease(self, run: str) -> str:
        """Lease of a run: a string that expires unless the run renews it."""
        return f"{self.namespace}:{{runs}}:lease:{run}"

    def held(self, run: str) -> str:
        """Hash of what a run holds, from id to owner and client; everything of a run is found through it."""
        return f"{self.namespace}:{{runs}}:held:{run}"

    def record(self, id: str) -> str:
        """Hash of one subscription: its request, holder and delivery.

        It exists if and only if the subscription is accepted.
        """
        return f"{self.namespace}:subscription:{{{id}}}"

    def queue(self, id: str) -> str:
        """Stream of pending deliveries."""
        return f"{self.record(id)}:queue"

    def sent(self, id: str) -> str:
        """Hash from the path of a resource to its version that was queued last."""
        return f"{self.record(id)}:sent"

    def gone(self, id: str) -> str:
        """Counter of runs that are deleting the subscription, for a run that may be about to write its record."""
        return f"{self.record(id)}:gone"

    def owner(self, path: str) -> str:
        """Set of the ids that one container lists."""
        return f"{self.namespace}:owner:{path}"

    def client(self, address: str) -> str:
        """Set of the ids of one client address, which may be any text, since proxies are trusted."""
        return f"{self.namespace}:client:{quote(address, safe=':', errors='surrogatepass')}"

    @property
    def news(self) -> str:
        """Stream of messages between gateways."""
        return f"{self.namespace}:news"

    def parse(self, key: str) -> Key:
        """Parse a key of this namespace; ValueError for any other key."""
        match = _KEY.fullmatch(key.removeprefix(self.namespace + ":"))
        if not key.startswith(self.namespace + ":") or match is None:
            raise ValueError(f"{key!r} is no key of subscriptions in namespace {self.namespace!r}")
        if match["id"]:
            return Key(match["part"] or "record", match["id"])  # type: ignore[arg-type]
        if match["owner"]:
            return Key("owner", match["owner"])
        if match["client"] is not None:
            return Key("client", unquote(match["client"], errors="surrogatepass"))
        return Key(match["news"] or match["runs"] or match["run_kind"], match["run"] or "")  # type: ignore[arg-type]


TO_BE_CONFIRMED, DELETED = 2, 3  # returned by COMMIT when replicas must confirm; when there is no record to take

# KEYS: client; ARGV: id, limit. Returns 1 and counts the subscription if the client may have it, else 0.
COUNT = """
if redis.call('SISMEMBER', KEYS[1], ARGV[1]) == 1 then return 1 end
if redis.call('SCARD', KEYS[1]) >= tonumber(ARGV[2]) then return 0 end
return redis.call('SADD', KEYS[1], ARGV[1])
"""

# KEYS: record, queue, gone; ARGV: run, group or empty, 1 to take it from another run, 1 if there must be a record,
# fields of the record. Returns DELETED if there must be a record and is none. Returns 0 if other runs are deleting the
# subscription since this run began to list it, or have done so: it must then be listed again. Returns TO_BE_CONFIRMED
# if the server reports replicas, which must confirm a callback. The second value is the run that held it before, or
# empty.
COMMIT = """
if ARGV[4] == '1' and redis.call('EXISTS', KEYS[1]) == 0 then return {3, ''} end
local clearing = redis.call('GET', KEYS[3])
if clearing then
  if tonumber(clearing) <= 0 then redis.call('DEL', KEYS[3]) end
  return {0, ''}
end
local holder = redis.call('HGET', KEYS[1], 'holder') or ''
if holder == '' or holder == ARGV[1] or ARGV[3] == '1' then
  redis.call('HSET', KEYS[1], 'holder', ARGV[1], unpack(ARGV, 5))
  if ARGV[2] ~= '' and redis.call('EXISTS', KEYS[2]) == 0 then
    redis.call('XGROUP', 'CREATE', KEYS[2], ARGV[2], '0', 'MKSTREAM')
  end
end
if ARGV[2] == '' then return {1, holder} end
local info = redis.pcall('INFO', 'replication')
if type(info) == 'string' and info:find('state=online', 1, true) then return {2, holder} end
return {1, holder}
"""

# KEYS: hash or set; ARGV: field or member. Returns 1 if it exists. The write changes nothing, but a WAIT after it waits
# for everything that was written to the same server before.
REPEAT = """
if redis.call('TYPE', KEYS[1])['ok'] == 'hash' then
  local value = redis.call('HGET', KEYS[1], ARGV[1])
  if not value then return 0 end
  redis.call('HSET', KEYS[1], ARGV[1], value)
else
  if redis.call('SREM', KEYS[1], ARGV[1]) == 0 then return 0 end
  redis.call('SADD', KEYS[1], ARGV[1])
end
return 1
"""

# KEYS: any. Returns 1 if the server reports replicas.
REPLICAS = """
local info = redis.pcall('INFO', 'replication')
return type(info) == 'string' and info:find('state=online', 1, true) and 1 or 0
"""

# KEYS: record, queue, sent, gone; ARGV: milliseconds for deleting, the run that must hold it or empty for any. Returns
# the former record, or nothing.
REMOVE = """
local holder = redis.call('HGET', KEYS[1], 'holder')
if ARGV[2] ~= '' and holder ~= ARGV[2] then return {} end
local fields = redis.call('HGETALL', KEYS[1])
redis.call('DEL', KEYS[1], KEYS[2], KEYS[3])
if holder then
  redis.call('INCR', KEYS[4])
  redis.call('PEXPIRE', KEYS[4], ARGV[1])
end
return fields
"""

# KEYS: record, gone; ARGV: milliseconds for deleting. Returns 1 if there is no record.
RECLAIM = """
if redis.call('EXISTS', KEYS[1]) == 1 then return 0 end
redis.call('INCR', KEYS[2])
redis.call('PEXPIRE', KEYS[2], ARGV[1])
return 1
"""

# KEYS: gone. One run has finished deleting.
CLEARED = """
if redis.call('EXISTS', KEYS[1]) == 1 then redis.call('DECR', KEYS[1]) end
return 1
"""

# KEYS: record; ARGV: holder as read, run. Returns whether this call made the run the holder, and the holder afterwards:
# of several runs only one can win.
TAKE = """
local holder = redis.call('HGET', KEYS[1], 'holder')
if holder ~= ARGV[1] then return {0, holder} end
redis.call('HSET', KEYS[1], 'holder', ARGV[2])
return {1, ARGV[2]}
"""

# KEYS: runs, held, lease; ARGV: run, the value of a lease that was left. A run that may come back or holds something is
# not forgotten.
RETIRE = """
local lease = redis.call('GET', KEYS[3])
local gone = not lease or lease == ARGV[2]
if gone and redis.call('EXISTS', KEYS[2]) == 0 then redis.call('SREM', KEYS[1], ARGV[1]) end
return 1
"""

# KEYS: record. Returns the record, active again, or nothing.
WAKE = """
if redis.call('EXISTS', KEYS[1]) == 0 then return {} end
redis.call('HSET', KEYS[1], 'state', 'active', 'failures', '0', 'reason', '')
return redis.call('HGETALL', KEYS[1])
"""

# KEYS: record, sent; ARGV: revision that was read, options, 1 to send everything anew. Returns the holder, or nothing
# if there is no record or its options have changed since. A message rendered for a revision before ``anew`` does not
# have the state that the receiver must get, so ADVANCE does not remember it as sent.
CHANGE = """
local holder = redis.call('HGET', KEYS[1], 'holder')
local revision = redis.call('HGET', KEYS[1], 'revision') or '0'
if not holder or revision ~= ARGV[1] then return false end
redis.call('HSET', KEYS[1], 'revision', revision + 1, 'options', ARGV[2])
if ARGV[3] == '1' then
  redis.call('HSET', KEYS[1], 'anew', revision + 1)
  redis.call('DEL', KEYS[2])
end
return holder
"""

# KEYS: record; ARGV: run, fields of the record. Returns 1 if the run holds it.
NOTE = """
if redis.call('HGET', KEYS[1], 'holder') ~= ARGV[1] then return 0 end
redis.call('HSET', KEYS[1], unpack(ARGV, 2))
return 1
"""

# KEYS: record, queue, sent; ARGV: run, group. Returns nothing if another run holds the subscription, else the entries,
# the sent versions and the last number. Consumers of earlier runs are deleted once nothing is pending with them.
BACKLOG = """
if redis.call('HGET', KEYS[1], 'holder') ~= ARGV[1] then return false end
local cursor = '0-0'
repeat
  cursor = redis.call('XAUTOCLAIM', KEYS[2], ARGV[2], ARGV[1], 0, cursor, 'COUNT', 100, 'JUSTID')[1]
until cursor == '0-0'
redis.call('XREADGROUP', 'GROUP', ARGV[2], ARGV[1], 'STREAMS', KEYS[2], '>')
for _, consumer in ipairs(redis.call('XINFO', 'CONSUMERS', KEYS[2], ARGV[2])) do
  if consumer[2] ~= ARGV[1] then redis.call('XGROUP', 'DELCONSUMER', KEYS[2], ARGV[2], consumer[2]) end
end
local number = tonumber(redis.call('HGET', KEYS[1], 'number') or 0)
return {redis.call('XRANGE', KEYS[2], '-', '+'), redis.call('HGETALL', KEYS[3]), number}
"""

# KEYS: record, queue, sent; ARGV: run, group, delivered entry or empty, number of delivery fields, these fields, number
# of paths to forget, these paths, and optionally path, version, media type, body and revision of the outgoing message
# and the number that it must get or empty. Returns nothing if another run holds the subscription, else the new entry
# and its number if there is one; if the wanted number is not the next one, nothing is done. The fields are written
# first: if memory for them is missing, nothing at all is done. Paths are forgotten last: one may be that of the
# outgoing message, sent for the last time.
ADVANCE = """
if redis.call('HGET', KEYS[1], 'holder') ~= ARGV[1] then return false end
local fields = tonumber(ARGV[4])
local first = 6 + fields
local last = first + tonumber(ARGV[first - 1]) - 1
local path, version, media_type, body, revision, wanted = unpack(ARGV, last + 1)
local given = tonumber(redis.call('HGET', KEYS[1], 'number') or 0)
if wanted and wanted ~= '' and tonumber(wanted) ~= given + 1 then return {} end
redis.call('HSET', KEYS[1], unpack(ARGV, 5, 4 + fields))
if ARGV[3] ~= '' then
  redis.call('XACK', KEYS[2], ARGV[2], ARGV[3])
  redis.call('XDEL', KEYS[2], ARGV[3])
end
local function forget()
  for index = first, last do redis.call('HDEL', KEYS[3], ARGV[index]) end
end
if not path then
  forget()
  return {}
end
local number = redis.call('HINCRBY', KEYS[1], 'number', 1)
local entry = redis.call('XADD', KEYS[2], '*', 'number', number, 'path', path, 'version', version,
  'media_type', media_type, 'body', body)
if tonumber(revision) >= tonumber(redis.call('HGET', KEYS[1], 'anew') or '0') then
  redis.call('HSET', KEYS[3], path, version)
end
forget()
redis.call('XREADGROUP', 'GROUP', ARGV[2], ARGV[1], 'COUNT', 1, 'STREAMS', KEYS[2], '>')
return {entry, number}
"""
