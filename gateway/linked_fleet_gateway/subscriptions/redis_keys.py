"""Every Redis key of the subscriptions, built and parsed here and nowhere else.

Braces are the hash tags of Redis Cluster: keys with the same tag live in one slot, so that one script can touch them
together. One tag holds who is alive and what each run holds; each subscription has a tag of its own.
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
    """A parsed key; ``name`` is the run, id, path or address that it is about, empty if there is only one."""

    kind: Kind
    name: str = ""


@dataclass(frozen=True)
class Keys:
    """All keys under one namespace; ValueError when the namespace would make them ambiguous."""

    namespace: str = "fleet"

    def __post_init__(self) -> None:
        if not _NAMESPACE.fullmatch(self.namespace):
            raise ValueError(f"namespace {self.namespace!r} is not a plain key such as 'fleet' or 'site/hall-2'")

    @property
    def runs(self) -> str:
        """Set of the runs of gateways that are alive or hold something."""
        return f"{self.namespace}:{{runs}}"

    def lease(self, run: str) -> str:
        """String that expires when the run does not renew it."""
        return f"{self.namespace}:{{runs}}:lease:{run}"

    def held(self, run: str) -> str:
        """Hash of the subscriptions that a run holds, from id to owner and client: the way to all that is theirs."""
        return f"{self.namespace}:{{runs}}:held:{run}"

    def record(self, id: str) -> str:
        """Hash of one subscription: what was asked for, its holder and delivery; its existence is the acceptance."""
        return f"{self.namespace}:subscription:{{{id}}}"

    def queue(self, id: str) -> str:
        """Stream of the deliveries that are not done yet."""
        return f"{self.record(id)}:queue"

    def sent(self, id: str) -> str:
        """Hash from the path of a resource to the version of it that was queued last."""
        return f"{self.record(id)}:sent"

    def gone(self, id: str) -> str:
        """Count of those who clear the subscription away, for the run that is perhaps about to write its record."""
        return f"{self.record(id)}:gone"

    def owner(self, path: str) -> str:
        """Set of ids that one container lists."""
        return f"{self.namespace}:owner:{path}"

    def client(self, address: str) -> str:
        """Set of ids that one client address has asked for; any text, since proxies are believed what they say."""
        return f"{self.namespace}:client:{quote(address, safe=':', errors='surrogatepass')}"

    @property
    def news(self) -> str:
        """Stream of what gateways tell each other."""
        return f"{self.namespace}:news"

    def parse(self, key: str) -> Key:
        """Parse any key of this namespace; ValueError for every other key."""
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
