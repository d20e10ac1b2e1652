"""All Redis keys of actions, built here and nowhere else.

Braces are hash tags of Redis Cluster: keys with the same tag share a slot, so that one script can access them. Each
robot has its own tag, so has the fleet as a whole, and one tag holds all settings.
"""

import hashlib
import re
from dataclasses import dataclass

from linked_fleet_agent.wire.names import escape, unescape
from linked_fleet_gateway.fleet.invocations import FLEET

_NAMESPACE = re.compile(r"[A-Za-z0-9_./-]+")
_FLEET_TAG = "@fleet"  # no robot has it, because escaped names do not contain this sign
_SETTINGS_TAG = "@settings"


def tag(robot: str) -> str:
    """Return the part of a key for a robot or the fleet. Raises ValueError for an invalid name."""
    return _FLEET_TAG if robot == FLEET else escape(robot)


def robot_of(tag: str) -> str:
    """Invert ``tag``. Raises ValueError for other texts."""
    return FLEET if tag == _FLEET_TAG else unescape(tag)


@dataclass(frozen=True)
class Keys:
    """All keys under one namespace. Raises ValueError if the namespace would make them ambiguous."""

    namespace: str = "fleet"

    def __post_init__(self) -> None:
        if not _NAMESPACE.fullmatch(self.namespace):
            raise ValueError(f"namespace {self.namespace!r} is not a plain key such as 'fleet' or 'site/hall-2'")

    @property
    def robots(self) -> str:
        """Sorted set of the tags of robots with invocations, by the day of the last one."""
        return f"{self.namespace}:actions:robots"

    def invocations(self, robot: str) -> tuple[str, str, str]:
        """Return the keys of a robot's invocations.

        A hash by id, and sorted sets of ids by expiry (Unix ms) and, of those that are over, by creation (Unix µs).
        """
        return self._of(robot, "invocations"), self._of(robot, "forgotten"), self._of(robot, "over")

    def repeat(self, robot: str, key: str) -> str:
        """Hash of the request that used an idempotency key, which may be any text."""
        return self._of(robot, f"key:{hashed(key)}")

    def lease(self, robot: str) -> str:
        """Hash of the lease of a robot, which expires with the lease."""
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
        """Stream of changes, for other gateways."""
        return f"{self.namespace}:actions:news"

    def _of(self, robot: str, part: str) -> str:
        return f"{self.namespace}:actions:{{{tag(robot)}}}:{part}"


def hashed(text: str) -> str:
    """Return a hash of any text; secrets and long texts are in Redis in this form only."""
    return hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()
