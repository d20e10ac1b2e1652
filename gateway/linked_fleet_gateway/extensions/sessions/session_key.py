"""The key that seals sessions, shared by gateways through Redis."""

import asyncio
import base64
import secrets
from pathlib import Path

from linked_fleet_gateway.extensions.sessions.sealed_cookie import KEY_BYTES
from linked_fleet_gateway.identity.roster import BadRoster
from linked_fleet_gateway.runtime.redis import Connection, StoreUnavailable

__all__ = ["SessionKey", "StoreUnavailable"]


class SessionKey:
    """A key of 32 random bytes, created by the first gateway and cached by each, so that Redis may be unavailable
    later.

    ``file`` is a path of the key in base64 to use instead, or empty.
    """

    def __init__(self, url: str, namespace: str, file: str) -> None:
        self._redis = Connection(url, f"{namespace}:identity:news")
        self._name = f"{namespace}:identity:session-key"
        self._key = read_key(Path(file)) if file else b""
        self._turn = asyncio.Lock()

    async def aclose(self) -> None:
        await self._redis.close()

    @property
    def known(self) -> bool:
        return bool(self._key)

    async def get(self) -> bytes:
        """Return the key. Raises StoreUnavailable if it was never read."""
        async with self._turn:
            if not self._key:
                await self._redis.one("SET", self._name, secrets.token_bytes(KEY_BYTES), "NX")
                found: bytes | None = await self._redis.one("GET", self._name)
                if found is None or len(found) != KEY_BYTES:
                    raise StoreUnavailable("the key of sessions is not in Redis")
                self._key = found
        return self._key


def read_key(path: Path) -> bytes:
    """Read the key from a file. Raises BadRoster if it is invalid."""
    try:
        key = base64.b64decode(path.read_bytes().strip(), validate=True)
    except OSError as error:
        raise BadRoster(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise BadRoster(f"{path}: the key of sessions is in base64") from error
    if len(key) != KEY_BYTES:
        raise BadRoster(f"{path} has {len(key)} bytes; the key of sessions has {KEY_BYTES}, in base64")
    return key
