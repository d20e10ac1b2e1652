"""The errors of the core as one tree; each knows how it looks from outside. Those of extensions are with them.

    FleetError                      status  code
    ├── BadRequest                  400     bad-request
    ├── Unauthenticated             401     unauthenticated
    ├── InsufficientScope           403     insufficient-scope
    ├── NotFound                    404     not-found
    ├── MethodNotAllowed            405     method-not-allowed
    ├── NotAcceptable               406     not-acceptable
    ├── Conflict                    409     conflict
    │   ├── RefusedByAgent          409     refused
    │   ├── Changed                 409     changed
    │   ├── Controlled              409     controlled
    │   └── ContainerFull           409     conflict
    ├── MotionRefused               409     motion-refused
    │   ├── NotReadYet              503     not-read-yet
    │   └── StopOwed                503     stop-owed
    ├── PreconditionFailed          412     precondition-failed
    ├── PayloadTooLarge             413     payload-too-large
    ├── UnsupportedMediaType        415     unsupported-media-type
    ├── ForeignOrigin               403     foreign-origin
    ├── MisdirectedRequest          421     misdirected-request
    ├── UnprocessableContent        422     unprocessable-content
    │   └── KeyReused               422     key-reused
    ├── UpgradeRequired             426     upgrade-required
    ├── TooManySubscriptions        429     too-many-subscriptions
    ├── TooManyInvocations          429     too-many-invocations
    ├── TooManyRequests             429     too-many-requests
    ├── FieldsTooLarge              431     fields-too-large
    ├── Unimplemented               501     not-implemented
    ├── Offline                     503     offline
    ├── Busy                        503     busy
    ├── RedisUnavailable            503     redis-unavailable
    │   └── DataDamaged             503     redis-unavailable
    ├── IssuerDown                  503     issuer-away
    ├── LibraryMissing              503     library-missing
    └── AgentTimeout                504     agent-silent
        ├── OperationTimeout        504     not-accepted
        └── StopUnanswered          504     agent-silent

The problem type (RFC 9457, 3.1.1) of each is ``PROBLEMS`` followed by its code; ``http.problem`` renders them.
"""

# ruff: noqa: N818  (the names are those of the status codes, RFC 9110, 15)

from collections.abc import Mapping, Sequence
from typing import ClassVar

from pyoxigraph import BlankNode, Literal, NamedNode

Statement = tuple[NamedNode | BlankNode, NamedNode, NamedNode | BlankNode | Literal]
Members = dict[str, str | int | float | list[str] | list[float] | list[dict[str, str]]]
PROBLEMS = "https://w3id.org/linked-fleet/problems#"
PROBLEM_JSON = "application/problem+json"
REALM = "linked-fleet"
_CONSTRAINED_BY = "http://www.w3.org/ns/ldp#constrainedBy"  # LDP 4.2.1.6


class FleetError(Exception):
    """A request cannot be served; ``detail`` says what was wrong and what would be right."""

    status: ClassVar[int] = 500
    code: ClassVar[str] = "internal"
    title: ClassVar[str] = "The gateway failed"
    retry_after_s: ClassVar[int | None] = None
    """Seconds after which the request may succeed, if they are the same for all errors of this kind."""
    member_names: ClassVar[tuple[str, ...]] = ("constraint",)
    """Attributes that are extension members (RFC 9457, 3.2) unless they are None."""

    def __init__(
        self, detail: str, *, headers: Mapping[str, str] | None = None, report: Sequence[Statement] | None = None
    ) -> None:
        super().__init__(str(detail))
        self.detail = str(detail)
        self.sentence = detail
        """The detail, with what it was made of if that is a ``Sentence``, so that it can be said in other languages."""
        self.headers: dict[str, str] = dict(headers or {})
        if self.retry_after_s is not None:
            self.headers["Retry-After"] = str(self.retry_after_s)
        self.report = report
        self.constraint: str | None = None
        self.added: Members = {}
        """Further extension members, beside ``members``, of whoever passes the error on and knows more about it."""

    def constrain(self, constraint: str) -> None:
        """Add a link to the description of the violated constraints, if there is none yet (LDP 4.2.1.6)."""
        if self.constraint is None:
            self.constraint = constraint
            self.headers["Link"] = f'<{constraint}>; rel="{_CONSTRAINED_BY}"'

    @property
    def type(self) -> str:
        return PROBLEMS + self.code

    @property
    def members(self) -> Members:
        known = {name: getattr(self, name) for name in self.member_names}
        return {name: value for name, value in known.items() if value is not None}

    def __str__(self) -> str:
        return f"{self.status} {self.title}: {self.detail}"


class BadRequest(FleetError):
    """The request is malformed; ``line`` and ``column`` count from 1 if the body is at fault."""

    status, code, title = 400, "bad-request", "The request is malformed"
    member_names = ("line", "column")

    def __init__(
        self,
        detail: str,
        *,
        line: int | None = None,
        column: int | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(detail, headers=headers)
        self.line, self.column = line, column


class Unauthenticated(FleetError):
    """Authentication is required (RFC 6750, 3); ``wrong`` says that the credentials sent are invalid or expired."""

    status, code, title = 401, "unauthenticated", "Say who you are"

    def __init__(self, detail: str, *, wrong: bool = False) -> None:
        error = ', error="invalid_token"' if wrong else ""
        super().__init__(detail, headers={"WWW-Authenticate": f'Bearer realm="{REALM}"{error}'})
        self.wrong = wrong


class InsufficientScope(FleetError):
    """The caller lacks the right ``scope`` (RFC 6750, 3.1)."""

    status, code, title = 403, "insufficient-scope", "You have no right to this"
    member_names = ("scope",)

    def __init__(self, detail: str, *, scope: str) -> None:
        challenge = f'Bearer realm="{REALM}", error="insufficient_scope", scope="{scope}"'
        super().__init__(detail, headers={"WWW-Authenticate": challenge})
        self.scope = scope


class NotFound(FleetError):
    """No such resource exists, or the caller may not read it: both answer alike."""

    status, code, title = 404, "not-found", "There is no such resource"


class MethodNotAllowed(FleetError):
    """The resource has other methods, which ``Allow`` must list (RFC 9110, 15.5.6)."""

    status, code, title = 405, "method-not-allowed", "The resource does not have this method"
    member_names = ("allow",)

    def __init__(self, detail: str, *, allow: Sequence[str], headers: Mapping[str, str] | None = None) -> None:
        super().__init__(detail, headers={**(headers or {}), "Allow": ", ".join(allow)})
        self.allow = list(allow)


class NotAcceptable(FleetError):
    """No representation matches ``Accept``; ``offered`` are the available media types."""

    status, code, title = 406, "not-acceptable", "No acceptable representation"
    member_names = ("offered",)

    def __init__(self, detail: str, *, offered: Sequence[str], headers: Mapping[str, str] | None = None) -> None:
        super().__init__(detail, headers=headers)
        self.offered = list(offered)


class Conflict(FleetError):
    """The state of the resource forbids the request, for example because a container is full."""

    status, code, title = 409, "conflict", "The state of the resource forbids it"


class RefusedByAgent(Conflict):
    """The robot's agent refused the command: stale, outside limits, busy or held."""

    code, title = "refused", "The robot refused the command"


class Changed(Conflict):
    """The body states expected joint positions (``lf:precondition``), and the joints are elsewhere."""

    code, title = "changed", "The robot is not where the motion was planned for"


class MotionRefused(FleetError):
    """A guard refuses a motion, or cannot check it; ``reason`` is stored with the invocation.

    Guards raise subclasses. Their code identifies the error when the first answer to a request is repeated.
    """

    status, code, title = 409, "motion-refused", "A guard refuses the motion"

    def __init__(self, detail: str, *, reason: str = "") -> None:
        super().__init__(detail)
        self.reason = reason

    def locate(self, base: str) -> None:
        """Resolve paths in the error to IRIs below ``base``."""

    @classmethod
    def type_for_code(cls, code: str) -> "type[MotionRefused] | None":
        """Return the guard error with this code, or None."""
        below = (each.type_for_code(code) for each in cls.__subclasses__())
        return cls if cls.code == code else next((each for each in below if each is not None), None)


class NotReadYet(MotionRefused):
    """A gateway that has just begun, or whose data in Redis are damaged, does not know what motions are judged by."""

    status, code, title = 503, "not-read-yet", "What motions are judged by is not known yet"
    retry_after_s = 2


class StopOwed(MotionRefused):
    """An agent has not confirmed a stop of the robot, which no motion may overtake."""

    status, code, title = 503, "stop-owed", "A stop of the robot is not confirmed yet"
    retry_after_s = 1


class Controlled(Conflict):
    """Another caller has the control lease of the robot: ``holder``, until ``expires``."""

    code, title = "controlled", "Somebody else controls the robot"
    member_names = ("holder", "expires")

    def __init__(self, detail: str, *, holder: str, expires: str) -> None:
        super().__init__(detail)
        self.holder, self.expires = holder, expires


class ContainerFull(Conflict):
    """The container is full."""


class PreconditionFailed(FleetError):
    """``If-Match`` or ``If-None-Match`` names another state of the resource."""

    status, code, title = 412, "precondition-failed", "The resource has changed"


class PayloadTooLarge(FleetError):
    """The body has more bytes, triples or values than the resource takes."""

    status, code, title = 413, "payload-too-large", "The body is too large"


class UnsupportedMediaType(FleetError):
    """The media type of the body is not supported; ``offered`` are the supported types."""

    status, code, title = 415, "unsupported-media-type", "The media type is not supported"
    member_names = ("constraint", "offered")

    def __init__(self, detail: str, *, offered: Sequence[str] = (), headers: Mapping[str, str] | None = None) -> None:
        # RFC 9110, 12.5.1: Accept in a 415 response lists the content types that would have been accepted
        taken = {"Accept": ", ".join(offered)} if offered else {}
        super().__init__(detail, headers={**taken, **(headers or {})})
        self.offered = list(offered) or None


class ForeignOrigin(FleetError):
    """The request has the ``Origin`` of another site, which has no access by a session."""

    status, code, title = 403, "foreign-origin", "A page of another site may not do this"


class MisdirectedRequest(FleetError):
    """``Host`` names an authority that is not among the public URLs of the gateway."""

    status, code, title = 421, "misdirected-request", "The fleet is not known under this authority"


class UnprocessableContent(FleetError):
    """The body violates a shape; ``report``: SHACL; ``constraint``: its IRI; ``unused``: statements without effect."""

    status, code, title = 422, "unprocessable-content", "The content breaks a constraint"
    member_names = ("constraint", "unused")

    def __init__(
        self,
        detail: str,
        *,
        report: Sequence[Statement] | None = None,
        constraint: str | None = None,
        unused: Sequence[str] = (),
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(detail, headers=headers, report=report)
        self.unused = list(unused) or None
        if constraint is not None:
            self.constrain(constraint)


class KeyReused(UnprocessableContent):
    """The Idempotency-Key was used for another request within the last day."""

    code, title = "key-reused", "The idempotency key was used for another request"


class UpgradeRequired(FleetError):
    """The request needs an ``Upgrade`` field, which proxies and HTTP/2 remove (RFC 9110, 7.8 and 15.5.22)."""

    status, code, title = 426, "upgrade-required", "The request lacks its Upgrade"

    def __init__(self, detail: str, *, protocol: str) -> None:
        super().__init__(detail, headers={"Upgrade": protocol, "Connection": "Upgrade"})


class TooManySubscriptions(FleetError):
    """The client has too many subscriptions (RFC 6585, 4). It must delete some or close streams."""

    status, code, title = 429, "too-many-subscriptions", "The client has too many subscriptions"


class TooManyInvocations(FleetError):
    """The client has too many running invocations (RFC 6585, 4). Stops are exempt."""

    status, code, title = 429, "too-many-invocations", "The client has too many motions that have not ended"
    retry_after_s = 1


class FieldsTooLarge(FleetError):
    """A header field has too many members, or the request too many fields (RFC 6585, 5)."""

    status, code, title = 431, "fields-too-large", "The header fields are too large"


class TooManyRequests(FleetError):
    """The client exceeds its request rate (RFC 6585, 4) and may retry after ``wait_s`` seconds. Stops are exempt."""

    status, code, title = 429, "too-many-requests", "The client asks too often"

    def __init__(self, wait_s: int) -> None:
        super().__init__(f"Ask again in {wait_s} s, and less often.", headers={"Retry-After": str(wait_s)})
        self.wait_s = wait_s


class Unimplemented(FleetError):
    """An optional feature of a standard that this gateway does not offer."""

    status, code, title = 501, "not-implemented", "The gateway does not offer this"


class Offline(FleetError):
    """The robot has no agent that the gateway can reach."""

    status, code, title = 503, "offline", "The robot is offline"


class Busy(FleetError):
    """Too many slow requests are running, or the gateway itself was delayed; the client may retry."""

    status, code, title = 503, "busy", "The gateway is too busy"
    retry_after_s = 1


class RedisUnavailable(FleetError):
    """Redis does not serve: unreachable, loading, read-only, damaged, or without memory or a required replica.

    It is unknown if the command was executed. ``cause`` is for logs; it may name hosts.
    """

    status, code, title = 503, "redis-unavailable", "Redis is unavailable"
    retry_after_s = 2

    def __init__(self, cause: str) -> None:
        super().__init__(
            "Redis is unavailable, so what gateways share can be neither read nor changed. Live values, stops and "
            "bearer tokens need no Redis. Ask again in a moment."
        )
        self.cause = cause

    def __str__(self) -> str:
        return f"Redis is unavailable: {self.cause}"


class DataDamaged(RedisUnavailable):
    """Redis answers, and a key holds a value of another kind: its data are damaged, or another program has written."""


class IssuerDown(FleetError):
    """The keys of the token's issuer cannot be fetched."""

    status, code, title = 503, "issuer-away", "The issuer of the token cannot be reached"
    retry_after_s = 5


class LibraryMissing(FleetError):
    """A library that the request needs cannot be loaded, mostly because the system lacks one that it is linked with."""

    status, code, title = 503, "library-missing", "A library of the gateway cannot be loaded"

    @classmethod
    def for_module(cls, name: str, error: ImportError) -> "LibraryMissing":
        """Return the error for a module that could not be imported."""
        advice = "`linked-fleet doctor` says how to install what it lacks"
        return cls(f"The gateway cannot load {name} ({error}); {advice}.")


class AgentTimeout(FleetError):
    """The agent did not reply in time, so the outcome of the command is unknown."""

    status, code, title = 504, "agent-silent", "The robot's agent did not answer in time"


class OperationTimeout(AgentTimeout):
    """An action that is no motion was neither accepted nor refused in time, and was ended."""

    code, title = "not-accepted", "The action was not accepted in time"


class StopUnanswered(AgentTimeout):
    """Robots have not confirmed a stop, which is repeated until they do; names of robots of either kind."""

    member_names = ("unanswered", "answered")

    def __init__(
        self,
        detail: str,
        *,
        unanswered: Sequence[str],
        answered: Sequence[str] = (),
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(detail, headers=headers)
        self.unanswered, self.answered = list(unanswered), list(answered)
