"""Searches the audit in Redis: entries that a query selects, newest first.

Redis looks at the entries itself, some thousand at a time, between which it serves others. Only what is found comes to
the gateway.
"""

import asyncio
from collections.abc import Sequence

from msgspec import Struct

from linked_fleet_gateway.api import Busy
from linked_fleet_gateway.extensions.audit.entry import AuditEntry, read_entry
from linked_fleet_gateway.extensions.audit.query import Query
from linked_fleet_gateway.serving import RedisConnection

LOOK_AT_ONCE = 2000
"""Entries that one command looks at, which takes Redis about 5 ms."""
MAX_WAITING = 16
BY_PAGE = "p"
"""Ends the ids of what pages did by themselves, which are in a stream of their own."""
_Id = tuple[int, int, bool]
# KEYS: stream; ARGV: the ids between which entries are, the newer one first, how many to look at, how many to return,
# who, robot, resource, action, outcome, first time, time after the last one (19 digits or nothing), words in lower
# case. Returns the id of the last entry that was looked at, empty if there are no more, and the entries found, each as
# id, and names and values. Texts are compared in bytes: lower and upper case are equal in ASCII alone.
_FIND = """
local newer, older, most, wanted = ARGV[1], ARGV[2], tonumber(ARGV[3]), tonumber(ARGV[4])
local who, robot, resource, action, outcome, from, till = unpack(ARGV, 5, 11)
local function outcome_of(status)
  local number = tonumber(status)
  if not number then return 'ended' end
  return number < 400 and 'succeeded' or number < 500 and 'refused' or 'failed'
end
local function is_at(path)
  return path == resource or path:sub(1, #resource) == resource and
    (resource:sub(-1) == '/' or path:sub(#resource + 1, #resource + 1):find('[/#]') ~= nil)
end
local function fits(entry)
  if who ~= '' and entry.who ~= who then return false end
  local robots = ', ' .. (entry.robot or '') .. ', '
  if robot ~= '' and not robots:find(', ' .. robot .. ', ', 1, true) then return false end
  if resource ~= '' and not is_at(entry.target or '') and not is_at(entry.result or '') then return false end
  if action ~= '' and (entry.what or ''):lower() ~= action:lower()
    and not ((entry.target or '') .. '/'):find('/actions/' .. action .. '/', 1, true) then return false end
  if outcome ~= '' and outcome_of(entry.outcome) ~= outcome then return false end
  local at = ('0'):rep(19 - #(entry.at_ns or '')) .. (entry.at_ns or '')
  if from ~= '' and at < from or till ~= '' and at >= till then return false end
  if #ARGV > 11 then
    local all = {}
    for name, value in pairs(entry) do
      if name ~= 'at_ns' then all[#all + 1] = value end
    end
    local said = table.concat(all, '\\n'):lower()
    for n = 12, #ARGV do
      if not said:find(ARGV[n], 1, true) then return false end
    end
  end
  return true
end
local looked = redis.call('XREVRANGE', KEYS[1], newer, older, 'COUNT', most)
local found, last = {}, ''
for n = 1, #looked do
  local entry, pairs_ = {}, looked[n][2]
  for m = 1, #pairs_, 2 do entry[pairs_[m]] = pairs_[m + 1] end
  if fits(entry) then
    found[#found + 1] = looked[n]
    if #found == wanted then return {looked[n][1], found} end
  end
end
if #looked == most then last = looked[#looked][1] end
return {last, found}
"""


class Found(Struct, frozen=True):
    """Entries by id, newest first. ``newest`` is the id of the newest entry that commands and changes have, selected or
    not; ``has_more`` says that there are older ones that the query selects, or may be.
    """

    entries: Sequence[tuple[str, AuditEntry]]
    newest: str
    has_more: bool


class Search:
    """Searches streams, one search after the other, so that Redis serves others as well."""

    def __init__(self, redis: RedisConnection, commands: str, by_pages: str) -> None:
        self._redis, self._commands, self._by_pages = redis, commands, by_pages
        self._turn = asyncio.Lock()
        self._waiting = 0

    async def find(self, query: Query) -> Found:
        """Return what a query selects. Raises RedisUnavailable, Busy."""
        if self._waiting >= MAX_WAITING:
            raise Busy(f"{MAX_WAITING} searches of the audit wait; ask again in a moment.")
        self._waiting += 1
        try:
            async with self._turn:
                return await self._find(query)
        finally:
            self._waiting -= 1

    async def _find(self, query: Query) -> Found:
        newest = await self._redis.execute("XREVRANGE", self._commands, "+", "-", "COUNT", 1)
        entries = await self._in_stream(query, self._commands, by_page=False)
        if query.pages:
            entries = [*entries, *await self._in_stream(query, self._by_pages, by_page=True)]
            entries.sort(key=lambda each: _place(each[0]), reverse=True)
        shown = [(id, read_entry(pairs)) for id, pairs in entries[: query.limit]]
        return Found(shown, newest[0][0].decode() if newest else "", len(entries) > query.limit)

    async def _in_stream(self, query: Query, stream: str, *, by_page: bool) -> list[tuple[str, list[bytes]]]:
        """Return ids and contents of what a query selects in one stream, and of one more."""
        newer, older = _newer(query.before, by_page), _older(query.after, by_page)
        found: list[tuple[str, list[bytes]]] = []
        while True:
            left = query.limit + 1 - len(found)
            arguments: tuple[str | int, ...] = (newer, older, LOOK_AT_ONCE, left, *_asked(query))
            last, entries = await self._redis.run_script(_FIND, (stream,), *arguments)
            found += [(id.decode() + (BY_PAGE if by_page else ""), pairs) for id, pairs in entries]
            if not last or len(found) > query.limit:
                return found
            newer = "(" + last.decode()


def _asked(query: Query) -> list[str]:
    times = ["" if each is None else f"{each:019d}" for each in (query.from_ns, query.until_ns)]
    words = [each.encode().lower().decode() for each in query.text.split()]  # letters of ASCII alone, as Lua does
    return [query.who, query.robot, query.resource, query.action, query.outcome, *times, *words]


def _place(id: str) -> _Id:
    """Return the place of an id in time. Of two at one time, that of a page is the older one."""
    first, _, second = id.removesuffix(BY_PAGE).partition("-")
    return int(first), int(second), not id.endswith(BY_PAGE)


def _newer(before: str, by_page: bool) -> str:
    """Return the bound of the entries of a stream before an id."""
    if not before:
        return "+"
    includes = by_page and not before.endswith(BY_PAGE)
    return ("" if includes else "(") + before.removesuffix(BY_PAGE)


def _older(after: str, by_page: bool) -> str:
    """Return the bound of the entries of a stream after an id."""
    if not after:
        return "-"
    includes = after.endswith(BY_PAGE) and not by_page
    return ("" if includes else "(") + after.removesuffix(BY_PAGE)
