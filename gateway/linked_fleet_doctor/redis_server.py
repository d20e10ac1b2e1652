"""Checks of Redis: reachable, writable, durable, and with a correct clock."""

import asyncio
import os
import re
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_doctor.finding import Finding
from linked_fleet_gateway.subscriptions.redis_scripts import Keys
from linked_fleet_runtime.redis import Connection, InvalidUrl

_PASSWORD = re.compile(r"(?<=://)[^@/]*@")
_MOST_APART_S = 1.0


async def check_redis(url: str, namespace: str) -> AsyncIterator[Finding]:
    """Check the server at ``url`` without changing anything."""
    shown = _PASSWORD.sub("…@", url)
    try:
        connection = Connection(url, Keys(namespace).news)
    except InvalidUrl as error:
        yield Finding("redis", str(error), "write redis://HOST:PORT, rediss://, unix:// or redis+cluster://")
        return
    try:
        asked_s = time.time()
        told = await connection.execute("TIME")
        answered_s = time.time()
        yield Finding("redis", f"{shown} answers within {(answered_s - asked_s) * 1000:.0f} ms")
        yield _clock(told, asked_s, answered_s)
        async for each in _durability(connection, shown):
            yield each
    except (RedisUnavailable, TimeoutError) as error:
        yield Finding("redis", f"{shown} does not serve ({_PASSWORD.sub('…@', str(error))})", _advice(str(error)))
    finally:
        await connection.close()


def check_embedded_redis(folder: Path) -> Finding:
    """Check the folder of the embedded server, which is used without REDIS_URL."""
    existing = next(each for each in (folder, *folder.parents) if each.exists())
    if not (existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)):
        return Finding("redis", f"{folder} cannot be written", "choose another folder with --state-dir")
    return Finding("redis", f"without REDIS_URL the embedded server keeps its data in {folder}")


def _clock(told: Any, asked_s: float, answered_s: float) -> Finding:
    """Compare the server's clock with this machine's. Of a cluster one node is checked."""
    first = next(iter(told.values())) if isinstance(told, dict) else told
    seconds, micros = (int(each) for each in first)
    apart_s = seconds + micros / 1e6 - (asked_s + answered_s) / 2
    if abs(apart_s) > _MOST_APART_S + (answered_s - asked_s):
        word = "ahead of" if apart_s > 0 else "behind"
        sentence = f"the clock of Redis is {abs(apart_s):.1f} s {word} that of this machine"
        return Finding("clocks", sentence, "have both set by NTP")
    return Finding("clocks", f"that of Redis is {apart_s * 1000:+.0f} ms from that of this machine")


async def _durability(connection: Connection, shown: str) -> AsyncIterator[Finding]:
    """Check settings that could lose accepted data."""
    told = await connection.execute("INFO")
    if not isinstance(told, dict) or "maxmemory_policy" not in told:
        return  # a cluster answers for each node
    if told["maxmemory_policy"] != "noeviction":
        sentence = f"{shown} forgets keys when its memory is full (maxmemory-policy {told['maxmemory_policy']})"
        yield Finding("redis", sentence, "set maxmemory-policy noeviction")
    if not told.get("aof_enabled"):
        sentence = f"{shown} keeps nothing of the last seconds when it ends (appendonly no)"
        yield Finding("redis", sentence, "set appendonly yes and appendfsync always", is_note=True)


def _advice(error: str) -> str:
    if "Authentication" in error or "NOAUTH" in error or "WRONGPASS" in error:
        return "correct the name and the password in REDIS_URL"
    if "certificate" in error.lower() or "ssl" in error.lower():
        return "name the authority of its certificate in REDIS_URL: ?ssl_ca_certs=FILE"
    return "start it, or correct the address in REDIS_URL"


async def collect_within(findings: AsyncIterator[Finding], timeout_s: float) -> list[Finding]:
    """Return the findings of a check within a time limit."""
    found: list[Finding] = []
    try:
        async with asyncio.timeout(timeout_s):
            async for each in findings:
                found.append(each)
    except TimeoutError:
        found.append(Finding("redis", f"it did not answer within {timeout_s:.0f} s", "look at the server's log"))
    return found
