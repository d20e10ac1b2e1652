"""Rights of callers on robots; pure values."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from fnmatch import translate
from functools import cached_property, lru_cache


class Right(StrEnum):
    """Kinds of rights. ``ACT`` includes ``STOP``; no other right includes another."""

    READ = "read"
    SUBSCRIBE = "subscribe"
    STOP = "stop"
    ACT = "act"
    PERSON = "person"
    RESET = "reset"
    ADMIN = "admin"


EVERY = "*"
"""The pattern that matches all robots."""


@dataclass(frozen=True)
class View:
    """The robots that a caller sees, by name patterns; all robots for ``ALL``.

    Views are compared, because what is rendered for one is not shown to another. Create them with ``of``.
    """

    patterns: tuple[str, ...]
    name: str = ""

    @staticmethod
    @lru_cache(maxsize=4096)
    def of(patterns: frozenset[str], name: str) -> "View":
        """Return the same object for the same robots; everybody who sees all robots shares ``ALL``."""
        return ALL if EVERY in patterns else View(tuple(sorted(patterns)), name)

    @property
    def includes_all(self) -> bool:
        return EVERY in self.patterns

    def includes(self, robot: str) -> bool:
        return self._patterns.match(robot) is not None

    def is_superset_of(self, other: "View") -> bool:
        """Return True if the patterns alone prove that it includes all robots of ``other``."""
        return self.includes_all or set(other.patterns) <= set(self.patterns)

    @cached_property
    def _patterns(self) -> re.Pattern[str]:
        # Case-sensitive on every platform; without patterns nothing matches.
        return re.compile("|".join(map(translate, self.patterns)) or r"(?!)")


ALL = View((EVERY,))


@dataclass(frozen=True)
class Grant:
    """Rights on robots, by name patterns."""

    scopes: frozenset[Right]
    robots: tuple[str, ...] = (EVERY,)

    def includes(self, scope: Right) -> bool:
        return scope in self.scopes or (scope is Right.STOP and Right.ACT in self.scopes)


@dataclass(frozen=True)
class TokenHash:
    """The proof of a static token: the SHA-256 of its text in hexadecimal."""

    sha256: str


@dataclass(frozen=True)
class Claims:
    """The proof of a token of an issuer. ``facts`` are the claims and values that grants refer to."""

    issuer: str
    subject: str
    facts: frozenset[tuple[str, str]]
    expires_ns: int


Credential = TokenHash | Claims
"""The proof of an identity, which can be checked again after the file has changed."""


@dataclass(frozen=True)
class Identity:
    """A caller; ``name`` is unique in the file of identities, ``expires_ns`` is wall time."""

    name: str
    grants: tuple[Grant, ...]
    expires_ns: int | None = None
    credential: Credential | None = None

    @staticmethod
    def reader(name: str, expires_ns: int, credential: Credential) -> "Identity":
        """Return the identity of somebody who reads all robots, and has no other right."""
        return Identity(name, (Grant(frozenset({Right.READ})),), expires_ns, credential)

    def view_for(self, scope: Right) -> View:
        """Return the robots on which it has the right."""
        return self._views[scope]

    def has_right(self, scope: Right, robot: str | None) -> bool:
        """Return True if it has the right on a robot.

        None means the fleet: any robot suffices, but ``ADMIN`` needs all.
        """
        robots = self.view_for(scope)
        if robot is None:
            return robots.includes_all if scope is Right.ADMIN else bool(robots.patterns)
        return robots.includes(robot)

    def has_any_right(self, scopes: Iterable[Right], robot: str | None) -> bool:
        return any(self.has_right(scope, robot) for scope in scopes)

    @cached_property
    def visible_robots(self) -> View:
        """The robots that it may read; others are invisible to it."""
        return self.view_for(Right.READ)

    @cached_property
    def _views(self) -> dict[Right, View]:
        given = {scope: [grant for grant in self.grants if grant.includes(scope)] for scope in Right}
        return {
            scope: View.of(frozenset(pattern for grant in grants for pattern in grant.robots), self.name)
            for scope, grants in given.items()
        }


EVERYBODY = Identity("", (Grant(frozenset(Right)),))
"""The caller if no identities are configured."""
NOBODY = Identity("", ())
"""The unauthenticated caller of a resource that needs no right."""
