"""Keys and atomic steps of the store of rules in Redis; all in one slot."""

import hashlib
from dataclasses import dataclass


@dataclass(frozen=True)
class Keys:
    namespace: str = "fleet"

    @property
    def records(self) -> str:
        """Hash of rules by id."""
        return self._key("records")

    @property
    def revisions(self) -> str:
        """Hash of revision numbers by id."""
        return self._key("revisions")

    @property
    def server(self) -> str:
        """The run of the gateway that evaluates rules; expires with its lease."""
        return self._key("server")

    @property
    def seen(self) -> str:
        """Set of the robots that were online at the last evaluation."""
        return self._key("seen")

    @property
    def news(self) -> str:
        """Stream of changes, for other gateways."""
        return self._key("news")

    def rules_of_client(self, client: str) -> str:
        """Set of the ids of the client's rules."""
        digest = hashlib.sha256(client.encode(errors="surrogatepass")).hexdigest()
        return self._key(f"client:{digest}")

    def keys_of_rule(self, id: str) -> tuple[str, str, str]:
        """Set of the keys of rows that hold, hash of counts, hash of firings by number."""
        return self._key(f"{id}:holds"), self._key(f"{id}:counts"), self._key(f"{id}:firings")

    def _key(self, part: str) -> str:
        return f"{self.namespace}:{{rules}}:{part}"


# KEYS: records, revisions, rules of the client, news; ARGV: id, rule, revision to replace (0: a new rule), limit of the
# client, total limit, run, number of news to keep.
WRITE = """
local have = redis.call('HGET', KEYS[2], ARGV[1]) or '0'
if have ~= ARGV[3] then return 'changed' end
if have == '0' then
  if redis.call('SCARD', KEYS[3]) >= tonumber(ARGV[4]) then return 'full' end
  if redis.call('HLEN', KEYS[1]) >= tonumber(ARGV[5]) then return 'crowded' end
  redis.call('SADD', KEYS[3], ARGV[1])
end
redis.call('HSET', KEYS[1], ARGV[1], ARGV[2])
redis.call('HINCRBY', KEYS[2], ARGV[1], 1)
redis.call('XADD', KEYS[4], 'MAXLEN', '~', ARGV[7], '*', 'id', ARGV[1], 'run', ARGV[6])
return 'written'
"""

# KEYS: records, revisions, rules of the client, news, the three keys of the rule; ARGV: id, run, number of news to
# keep, optionally the only revision to remove. Returns 1 if the rule existed.
REMOVE = """
if ARGV[4] and redis.call('HGET', KEYS[2], ARGV[1]) ~= ARGV[4] then return 'changed' end
redis.call('HDEL', KEYS[2], ARGV[1])
redis.call('SREM', KEYS[3], ARGV[1])
redis.call('DEL', KEYS[5], KEYS[6], KEYS[7])
redis.call('XADD', KEYS[4], 'MAXLEN', '~', ARGV[3], '*', 'id', ARGV[1], 'run', ARGV[2])
return redis.call('HDEL', KEYS[1], ARGV[1])
"""

# KEYS: records, revisions, counts, firings; ARGV: id. Returns rule, revision, counts and firings, consistently: the
# revision is that which the next write replaces.
READ = """
local counts, firings = redis.call('HGETALL', KEYS[3]), redis.call('HGETALL', KEYS[4])
return {redis.call('HGET', KEYS[1], ARGV[1]), redis.call('HGET', KEYS[2], ARGV[1]), counts, firings}
"""

# KEYS: server; ARGV: run, milliseconds. Returns the run that evaluates rules now.
SERVE = """
local server = redis.call('GET', KEYS[1])
if server and server ~= ARGV[1] then return server end
redis.call('SET', KEYS[1], ARGV[1], 'PX', ARGV[2])
return ARGV[1]
"""

# KEYS: server; ARGV: run.
LEAVE = "if redis.call('GET', KEYS[1]) == ARGV[1] then redis.call('DEL', KEYS[1]) end return 1"

# Checks that this run still evaluates rules and that the rule has this revision.
_MINE = """
if redis.call('GET', KEYS[1]) ~= ARGV[1] then return {'lost'} end
if redis.call('HGET', KEYS[2], ARGV[2]) ~= ARGV[3] then return {'changed'} end
"""

# KEYS: server, revisions, holds, counts, firings; ARGV: run, id, revision. Returns the keys of the rows that held at
# the last evaluation, or 'new' without one since the last write. Unfinished firings of another run become unknown.
RECALL = (
    _MINE
    + """
local firings = redis.call('HGETALL', KEYS[5])
for index = 1, #firings, 2 do
  if string.sub(firings[index + 1], 1, 8) == 'running ' then
    redis.call('HSET', KEYS[5], firings[index], 'unknown' .. string.sub(firings[index + 1], 8))
  end
end
if redis.call('HGET', KEYS[4], 'begun') ~= ARGV[3] then return {'new'} end
return {'held', unpack(redis.call('SMEMBERS', KEYS[3]))}
"""
)

# KEYS: as above; ARGV: run, id, revision, keys. Stores the rows that hold at the first evaluation, which do not fire.
BEGIN = (
    _MINE
    + """
redis.call('DEL', KEYS[3])
for index = 4, #ARGV do redis.call('SADD', KEYS[3], ARGV[index]) end
redis.call('HSET', KEYS[4], 'begun', ARGV[3])
return {'begun'}
"""
)

# KEYS: as above; ARGV: run, id, revision, least milliseconds between firings, most concurrent firings, number of
# firings to keep, number of rows that started to hold, key and firing of each, keys of rows that ceased to hold.
# Returns the numbers of the firings claimed for the first rows. The others are suppressed; of consecutive suppressed
# ones the first is kept as a firing.
ADVANCE = (
    _MINE
    + """
local time, began = redis.call('TIME'), tonumber(ARGV[7])
local now = time[1] * 1000 + math.floor(time[2] / 1000)
local counts = redis.call('HMGET', KEYS[4], 'fired_ms', 'last')
local passed = now - (tonumber(counts[1]) or -1e15)
local early = passed >= 0 and passed < tonumber(ARGV[4])
local last, answer = counts[2], {'advanced'}
for row = 1, began do
  local key, firing = ARGV[6 + 2 * row], ARGV[7 + 2 * row]
  redis.call('SADD', KEYS[3], key)
  local suppressed = early or row > tonumber(ARGV[5])
  if suppressed then redis.call('HINCRBY', KEYS[4], 'suppressed', 1) end
  local state = suppressed and 'suppressed' or 'running'
  if not suppressed or last ~= 'suppressed' then
    local number = redis.call('HINCRBY', KEYS[4], 'number', 1)
    redis.call('HSET', KEYS[5], number, state .. ' ' .. firing)
    redis.call('HDEL', KEYS[5], number - tonumber(ARGV[6]))
    if not suppressed then answer[#answer + 1] = tostring(number) end
  end
  last = state
end
for index = 8 + 2 * began, #ARGV do redis.call('SREM', KEYS[3], ARGV[index]) end
if began > 0 then redis.call('HSET', KEYS[4], 'last', last) end
if #answer > 1 then redis.call('HSET', KEYS[4], 'fired_ms', now) end
return answer
"""
)

# KEYS: firings; ARGV: number, firing.
FINISH = """
if redis.call('HEXISTS', KEYS[1], ARGV[1]) == 1 then redis.call('HSET', KEYS[1], ARGV[1], ARGV[2]) end
return 1
"""

# KEYS: server, revisions, counts; ARGV: run, id, revision, fault, suspension.
COMPLAIN = (
    _MINE
    + """
redis.call('HSET', KEYS[3], 'fault', ARGV[4], 'suspended', ARGV[5])
return {'complained'}
"""
)
