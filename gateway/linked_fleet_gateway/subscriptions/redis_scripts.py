"""The atomic steps of the store, as Lua that Redis runs. Each touches the keys of one slot only.

They are sent whole each time: they are short, and a server that restarted knows no script by its digest.
"""

TO_BE_CONFIRMED = 2  # what COMMIT answers when replicas are to be waited for

# KEYS: client; ARGV: id, limit. Whether the client may have the subscription, which is then counted.
COUNT = """
if redis.call('SISMEMBER', KEYS[1], ARGV[1]) == 1 then return 1 end
if redis.call('SCARD', KEYS[1]) >= tonumber(ARGV[2]) then return 0 end
return redis.call('SADD', KEYS[1], ARGV[1])
"""

# KEYS: record, queue, gone; ARGV: run, group or nothing, 1 to take it from another run, fields of the record.
# 0 when others clear the subscription away since its run began to list it, or have done so: it must be listed again;
# TO_BE_CONFIRMED when the server has replicas that are to confirm a callback, as far as it lets itself be asked; and
# the run that held it before, or nothing.
COMMIT = """
local clearing = redis.call('GET', KEYS[3])
if clearing then
  if tonumber(clearing) <= 0 then redis.call('DEL', KEYS[3]) end
  return {0, ''}
end
local holder = redis.call('HGET', KEYS[1], 'holder') or ''
if holder == '' or holder == ARGV[1] or ARGV[3] == '1' then
  redis.call('HSET', KEYS[1], 'holder', ARGV[1], unpack(ARGV, 4))
  if ARGV[2] ~= '' and redis.call('EXISTS', KEYS[2]) == 0 then
    redis.call('XGROUP', 'CREATE', KEYS[2], ARGV[2], '0', 'MKSTREAM')
  end
end
if ARGV[2] == '' then return {1, holder} end
local info = redis.pcall('INFO', 'replication')
if type(info) == 'string' and info:find('state=online', 1, true) then return {2, holder} end
return {1, holder}
"""

# KEYS: hash or set; ARGV: field or member. Whether there is one; what is written changes nothing, but a WAIT after it
# waits for all that was written before to the same server.
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

# KEYS: any. Whether its server has replicas, as far as it lets itself be asked.
REPLICAS = """
local info = redis.pcall('INFO', 'replication')
return type(info) == 'string' and info:find('state=online', 1, true) and 1 or 0
"""

# KEYS: record, queue, sent, gone; ARGV: milliseconds to clear away, the run that must hold it or nothing for any. The
# record as it was, or nothing.
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

# KEYS: record, gone; ARGV: milliseconds to clear away. Whether there is no record.
RECLAIM = """
if redis.call('EXISTS', KEYS[1]) == 1 then return 0 end
redis.call('INCR', KEYS[2])
redis.call('PEXPIRE', KEYS[2], ARGV[1])
return 1
"""

# KEYS: gone. One has finished to clear away.
CLEARED = """
if redis.call('EXISTS', KEYS[1]) == 1 then redis.call('DECR', KEYS[1]) end
return 1
"""

# KEYS: record; ARGV: holder as read, run. Whether this made the run the holder, and the holder after that: only one of
# several runs can win.
TAKE = """
local holder = redis.call('HGET', KEYS[1], 'holder')
if holder ~= ARGV[1] then return {0, holder} end
redis.call('HSET', KEYS[1], 'holder', ARGV[2])
return {1, ARGV[2]}
"""

# KEYS: runs, held, lease; ARGV: run, what the lease of one that has left says. A run that may come back, or holds
# something, is not forgotten.
RETIRE = """
local lease = redis.call('GET', KEYS[3])
local gone = not lease or lease == ARGV[2]
if gone and redis.call('EXISTS', KEYS[2]) == 0 then redis.call('SREM', KEYS[1], ARGV[1]) end
return 1
"""

# KEYS: record. The record, active again, or nothing.
WAKE = """
if redis.call('EXISTS', KEYS[1]) == 0 then return {} end
redis.call('HSET', KEYS[1], 'state', 'active', 'failures', '0', 'reason', '')
return redis.call('HGETALL', KEYS[1])
"""

# KEYS: record, sent; ARGV: revision that was read, options, 1 to send everything anew. The holder, or nothing when
# there is no record or its options have been changed since. What is rendered for a revision before ``anew`` is not the
# state that the receiver is to have, so ADVANCE does not remember it as sent.
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

# KEYS: record; ARGV: run, fields of the record. Whether the run holds it.
NOTE = """
if redis.call('HGET', KEYS[1], 'holder') ~= ARGV[1] then return 0 end
redis.call('HSET', KEYS[1], unpack(ARGV, 2))
return 1
"""

# KEYS: record, queue, sent; ARGV: run, group. Nothing for another's subscription, else entries, what was sent, and the
# number that was given last. Consumers of earlier runs are forgotten once nothing is pending with them.
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

# KEYS: record, queue, sent; ARGV: run, group, entry that is done or nothing, number of delivery fields, these, number
# of paths to forget, these, and perhaps path, version, media type, body and revision of what goes out, and the number
# that it is to get or nothing. Nothing for another's subscription, else the new entry and its number if there is one;
# nothing is done if that number is not the next. The fields come first: without memory for them nothing at all is done.
# What is to be forgotten comes last: it may be what goes out, for the last time.
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
