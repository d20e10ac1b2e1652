"""Rights of callers to robots; pure values."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from fnmatch import translate
from functools import cached_property, lru_cache


class Right(StrEnum):
    """Kinds of rights. ``ACT`` includes ``STOP``; nothing else includes anything."""

    READ = "read"
    SUBSCRIBE = "subscribe"
    STOP = "stop"
    ACT = "act"
    ADMIN = "admin"


EVERY = "*"
"""The pattern of all robots."""


@dataclass(frozen=True)
class View:
    """Some of the robots, by patterns over their names, as ``name`` has them in view; all robots for ``ALL``.

    Views are compared: what is rendered for one is not shown to another. Make them by ``view``.
    """

    patterns: tuple[str, ...]
    name: str = ""

    @property
    def all(self) -> bool:
        return EVERY in self.patterns

    def sees(self, robot: str) -> bool:
        return self._patterns.match(robot) is not None

    def covers(self, other: "View") -> bool:
        """Return True if it surely shows all that ``other`` does, by the patterns alone."""
        return self.all or set(other.patterns) <= set(self.patterns)

    @cached_property
    def _patterns(self) -> re.Pattern[str]:
        # Case matters and nothing depends on the platform; without patterns nothing matches.
        return re.compile("|".join(map(translate, self.patterns)) or r"(?!)")


ALL = View((EVERY,))


@lru_cache(maxsize=4096)
def view(patterns: frozenset[str], name: str) -> View:
    """The same object for the same robots; who sees them all sees what everybody sees who does."""
    return ALL if EVERY in patterns else View(tuple(sorted(patterns)), name)


@dataclass(frozen=True)
class Grant:
    """Rights to robots, by patterns over their names."""

    scopes: frozenset[Right]
    robots: tuple[str, ...] = (EVERY,)

    def gives(self, scope: Right) -> bool:
        return scope in self.scopes or (scope is Right.STOP and Right.ACT in self.scopes)


@dataclass(frozen=True)
class TokenHash:
    """Stands for a static token: the SHA-256 of its text, as hexadecimal digits."""

    sha256: str


@dataclass(frozen=True)
class Claims:
    """Stands for what an issuer said of a subject. ``facts``: claims and values that grants ask for."""

    issuer: str
    subject: str
    facts: frozenset[tuple[str, str]]
    expires_ns: int


Credential = TokenHash | Claims
"""The proof of an identity, which can be held against the file again when that has changed."""


@dataclass(frozen=True)
class Identity:
    """``name`` is unique among all that the file knows; ``expires_ns`` is wall time."""

    name: str
    grants: tuple[Grant, ...]
    expires_ns: int | None = None
    credential: Credential | None = None

    def over(self, scope: Right) -> View:
        """The robots to which it has the right."""
        return self._views[scope]

    def may(self, scope: Right, robot: str | None) -> bool:
        """Return True if it may do so to a robot; None is the fleet: to any robot, but ``ADMIN`` to all of them."""
        robots = self.over(scope)
        if robot is None:
            return robots.all if scope is Right.ADMIN else bool(robots.patterns)
        return robots.sees(robot)

    def may_any(self, scopes: Iterable[Right], robot: str | None) -> bool:
        return any(self.may(scope, robot) for scope in scopes)

    @property
    def sees(self) -> View:
        """The robots that it may read; of the rest it does not find out that they are there."""
        return self.over(Right.READ)

    @cached_property
    def _views(self) -> dict[Right, View]:
        given = {scope: [grant for grant in self.grants if grant.gives(scope)] for scope in Right}
        return {
            scope: view(frozenset(pattern for grant in grants for pattern in grant.robots), self.name)
            for scope, grants in given.items()
        }


EVERYBODY = Identity("", (Grant(frozenset(Right)),))
"""Whoever asks, where no identities are configured."""
NOBODY = Identity("", ())
"""The caller who has not said who they are, of a resource that needs no right."""
