"""Every Redis key of the actions, built here and nowhere else.

Braces are the hash tags of Redis Cluster: keys with the same tag live in one slot, so that one script can touch them
together. Each robot has a tag of its own, so has the fleet as a whole, and one holds the settings of all.
"""

import hashlib
import re
from dataclasses import dataclass

from linked_fleet_agent.wire.names import escape, unescape
from linked_fleet_gateway.fleet.invocations import FLEET

_NAMESPACE = re.compile(r"[A-Za-z0-9_./-]+")
_FLEET_TAG = "@fleet"  # no robot's: the escape of a name has no such sign
_SETTINGS_TAG = "@settings"


def tag(robot: str) -> str:
    """The part of a key that names a robot, or the whole fleet; ValueError for a text that is no name."""
    return _FLEET_TAG if robot == FLEET else escape(robot)


def robot_of(tag: str) -> str:
    """The inverse of ``tag``; ValueError for any other text."""
    return FLEET if tag == _FLEET_TAG else unescape(tag)


@dataclass(frozen=True)
class Keys:
    """All keys under one namespace; ValueError when the namespace would make them ambiguous."""

    namespace: str = "fleet"

    def __post_init__(self) -> None:
        if not _NAMESPACE.fullmatch(self.namespace):
            raise ValueError(f"namespace {self.namespace!r} is not a plain key such as 'fleet' or 'site/hall-2'")

    @property
    def robots(self) -> str:
        """Sorted set of the tags of robots with invocations, by the day of the last one."""
        return f"{self.namespace}:actions:robots"

    def invocations(self, robot: str) -> tuple[str, str, str]:
        """Hash of the invocations of a robot by id; sorted sets of ids by the time when each is forgotten (Unix ms),
        and, of those that are over, by creation (Unix µs)."""
        return self._of(robot, "invocations"), self._of(robot, "forgotten"), self._of(robot, "over")

    def repeat(self, robot: str, key: str) -> str:
        """Hash of the request that an idempotency key was used for; the key may be any text of any length."""
        return self._of(robot, f"key:{hashed(key)}")

    def lease(self, robot: str) -> str:
        """Hash of the lease of a robot; it expires with the lease."""
        return self._of(robot, "lease")

    def settings(self, robot: str) -> str:
        """Hash of the settings of a robot by name."""
        return f"{self.namespace}:actions:{{{_SETTINGS_TAG}}}:{tag(robot)}"

    @property
    def configured(self) -> str:
        """Set of the tags of robots with settings."""
        return f"{self.namespace}:actions:{{{_SETTINGS_TAG}}}"

    @property
    def news(self) -> str:
        """Stream of what gateways tell each other."""
        return f"{self.namespace}:actions:news"

    def _of(self, robot: str, part: str) -> str:
        return f"{self.namespace}:actions:{{{tag(robot)}}}:{part}"


def hashed(text: str) -> str:
    """A hash of any text; what is secret or may be long is in Redis in this form only."""
    return hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()
