"""All Redis keys of subscriptions, built and parsed only here.

Braces are the hash tags of Redis Cluster: keys with the same tag are in one slot, so that one script can use them
together. One tag holds which runs are alive and what each holds; each subscription has its own tag.
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
