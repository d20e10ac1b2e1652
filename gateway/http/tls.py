"""The gateway's own TLS, whose certificate can be replaced while it serves."""

import asyncio
import logging
import ssl
from pathlib import Path

from agents.wire.trust import check_pair

log = logging.getLogger(__name__)
LOOK_S = 10.0
"""How often the files are looked at."""


class Certificate:
    """A certificate chain and its key, PEM files; ValueError with one clear sentence when they are no pair."""

    def __init__(self, certificate: str, key: str) -> None:
        self._certificate, self._key = certificate, key
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.context.minimum_version = ssl.TLSVersion.TLSv1_2
        self.context.set_alpn_protocols(["http/1.1"])
        self._seen = self._state()
        self._load()

    def reload(self) -> None:
        """Have new connections see what the files hold now; files that are no pair change nothing but the log."""
        self._seen = self._state()
        try:
            self._load()
        except ValueError as error:
            log.error("the certificate in use stays: %s", error)
        else:
            log.info("new connections get the certificate of %s as it is now", self._certificate)

    async def follow(self) -> None:
        """Reload whenever the files have changed, until cancelled."""
        while True:
            await asyncio.sleep(LOOK_S)
            if self._state() != self._seen:
                self.reload()

    def _load(self) -> None:
        check_pair(self._certificate, self._key)  # a context that refused a key has the new certificate already
        self.context.load_cert_chain(self._certificate, self._key)

    def _state(self) -> list[tuple[int, int, int] | None]:
        """What tells a file from the one that was there before."""
        state: list[tuple[int, int, int] | None] = []
        for path in (self._certificate, self._key):
            try:
                status = Path(path).stat()
                state.append((status.st_ino, status.st_mtime_ns, status.st_size))
            except OSError:  # in the middle of being replaced, or gone: reload says so
                state.append(None)
        return state
