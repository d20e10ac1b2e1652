"""HTTP and RDF: bounded in size and time, revalidated by ETag; what may be repeated is (``retry.py``)."""

import logging
import re
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

import httpx
import rdflib
from rdflib.term import Node, URIRef

from linked_fleet_client.errors import BadAnswer, Unreachable, problem
from linked_fleet_client.graphs import load
from linked_fleet_client.retry import PATIENCE_S, Attempts, Repeat, repeat_of
from linked_fleet_client.vocabulary import document_of, is_web

ACCEPT = "text/turtle, application/n-triples;q=0.5, application/problem+json"
_FORMATS = {"text/turtle": "turtle", "application/x-turtle": "turtle", "application/n-triples": "nt"}
MAX_BODY_BYTES = 8 * 1024 * 1024
MAX_REDIRECTS = 5
_KEPT = 512
_SAME_REQUEST = frozenset({307, 308})
_REDIRECTS = frozenset({301, 302, 303, *_SAME_REQUEST})
# rdflib would expand such a number to all its digits: a few bytes on the wire, gigabytes in memory. A literal without a
# datatype is no number: the digest in a version may look like one.
_HUGE_NUMBER = re.compile(r"""["'][\s+-]*[\d._]+[eE][+-]?[\d_]{7,}\s*["']+(?:\s|#[^\n]*\n)*\^\^""")
# rdflib logs a traceback for every ill-typed literal; such a literal is ignored here.
logging.getLogger("rdflib.term").setLevel(logging.ERROR)


@dataclass(frozen=True)
class Document:
    """The answer for ``url``, the end of redirects. The graph is shared and must not be changed."""

    url: str
    graph: rdflib.Graph
    etag: str | None = None
    links: tuple[tuple[str, str], ...] = ()
    """(target, relation) of each member of the Link field."""
    digest: int = 0
    """Equal for equal bodies; for servers without ETag."""

    def iri(self, asked: str) -> URIRef:
        """Return the subject of the document for a request of ``asked``: that IRI, or the one it was redirected to."""
        found = URIRef(asked)
        redirected = URIRef(self.url)
        return found if (found, None, None) in self.graph or (redirected, None, None) not in self.graph else redirected


@dataclass(frozen=True)
class Answer:
    """A complete answer to a request."""

    url: str
    status: int
    headers: httpx.Headers
    body: bytes

    def location(self) -> str:
        """Return the target of the Location field. Raises BadAnswer if there is none."""
        target = self.headers.get("location")
        if not target:
            raise BadAnswer(f"{self.url} answers {self.status} without a Location field")
        try:
            return str(httpx.URL(self.url).join(target))
        except httpx.InvalidURL as error:
            raise BadAnswer(f"{self.url} has a Location field that is not a URL: {target[:200]!r}") from error


class Bearer(httpx.Auth):
    """A bearer token (RFC 6750) for the origin of ``url`` and for no other."""

    def __init__(self, token: str, url: str) -> None:
        self._token, self._home = token, origin(url)

    def auth_flow(self, request: httpx.Request) -> Generator[httpx.Request, httpx.Response, None]:
        if origin(request.url) == self._home:
            request.headers["authorization"] = f"Bearer {self._token}"
        yield request


def origin(iri: str | httpx.URL) -> tuple[str, str, int]:
    """Return scheme, host and port (RFC 6454). Raises BadAnswer if the IRI is no URL."""
    try:
        url = httpx.URL(iri)
    except httpx.InvalidURL as error:
        raise BadAnswer(f"{str(iri)[:200]!r} is not a URL") from error
    return url.scheme, url.host, url.port or (443 if url.scheme == "https" else 80)


class HeldControl(Protocol):
    """The control that this client has of a robot (``control.Control``)."""

    iri: rdflib.URIRef

    def check(self) -> None:
        """Check that the lease is held. Raises ControlLost."""

    @property
    def proof(self) -> dict[str, str]:
        """The field of a request by which its client is known to have control."""

    def send(self, method: str, url: str, body: bytes | None, headers: dict[str, str]) -> Answer:
        """Send the request of a motion with the proof. Raises ControlLost."""


@dataclass
class Web:
    """The connections of one client and its cached documents. Threads may share it.

    ``timeout_s`` bounds each connection attempt, each silence and, times three, a whole answer. ``patience_s`` bounds
    the pauses of a request that a busy server wants to be sent again later.
    """

    timeout_s: float = 10.0
    headers: Mapping[str, str] = field(default_factory=dict)
    auth: httpx.Auth | None = None
    patience_s: float = PATIENCE_S

    def __post_init__(self) -> None:
        headers = {"user-agent": "linked-fleet", **self.headers}
        self.http = httpx.Client(timeout=self.timeout_s, headers=headers, auth=self.auth)
        self._seen: OrderedDict[str, Document] = OrderedDict()
        self._lock = threading.Lock()
        self.controls: dict[str, HeldControl] = {}
        """Control of robots that this client has at present, by their IRIs."""

    def close(self) -> None:
        self.http.close()

    @property
    def has_read(self) -> bool:
        """True if a description has been read."""
        with self._lock:
            return bool(self._seen)

    def get(self, iri: str) -> Document:
        """Return the present description. Raises Unreachable, Problem or BadAnswer."""
        url = document_of(iri)
        seen = self._recall(url)
        headers = {"accept": ACCEPT} | ({"if-none-match": seen.etag} if seen and seen.etag else {})
        answer = self._safely("GET", url, headers)
        if answer.status == 304 and seen:
            return seen
        return self._keep(url, _document(answer))

    def allowed_methods(self, iri: str) -> set[str]:
        """Return the methods that OPTIONS advertises."""
        answer = self._safely("OPTIONS", document_of(iri), {})
        return {method.strip().upper() for method in answer.headers.get("allow", "").split(",") if method.strip()}

    def send(
        self, method: str, url: str, body: bytes | None, headers: Mapping[str, str], repeat: Repeat | None = None
    ) -> Answer:
        """Send an unsafe request, again if ``repeat`` permits; by default its method and Idempotency-Key tell that.

        Only 307 and 308 are followed, because other redirects change the request.
        """
        fields = {"accept": ACCEPT, **headers}
        once = partial(self._redirected, method, url, fields, body, _SAME_REQUEST)
        return self._repeatedly(repeat or repeat_of(method, headers), once)

    @contextmanager
    def stream(self, url: str, headers: Mapping[str, str], silence_s: float) -> Iterator[httpx.Response]:
        """Open a streaming answer. More than ``silence_s`` without a byte raises Unreachable."""
        timeout = httpx.Timeout(self.timeout_s, read=silence_s)
        self._check(url)
        with (
            _translated(url),
            self.http.stream("GET", url, headers=headers, timeout=timeout, follow_redirects=True) as response,
        ):
            yield response

    def credentials(self, url: str) -> dict[str, str]:
        """Return the fields by which this client is known at a URL, for a connection of another kind."""
        self._check(url)
        request = self.http.build_request("GET", url)
        if self.auth is not None:
            request = next(self.auth.sync_auth_flow(request))
        names = {"user-agent", "authorization", *(each.lower() for each in self.headers)}
        return {name: value for name, value in request.headers.items() if name.lower() in names}

    def read_body(self, response: httpx.Response) -> bytes:
        """Return the body of a streamed answer. Raises BadAnswer or Unreachable if it is too large or too slow."""
        deadline = time.monotonic() + 3 * self.timeout_s
        parts, size = [], 0
        for part in response.iter_bytes():
            parts.append(part)
            size += len(part)
            if size > MAX_BODY_BYTES:
                raise BadAnswer(f"{response.url} answers with more than {MAX_BODY_BYTES} bytes")
            if time.monotonic() > deadline:
                raise Unreachable(f"{response.url} takes too long to answer")
        return b"".join(parts)

    def _safely(self, method: str, url: str, headers: Mapping[str, str]) -> Answer:
        return self._repeatedly(Repeat.SAFE, partial(self._redirected, method, url, headers, None, _REDIRECTS))

    def _repeatedly(self, repeat: Repeat, once: Callable[[], Answer]) -> Answer:
        attempts = Attempts(repeat, self.patience_s)
        while True:
            try:
                answer = once()
            except Unreachable:
                if (pause_s := attempts.pause_s()) is None:
                    raise
            else:
                if answer.status < 400:
                    return answer
                if (pause_s := attempts.pause_s(answer.status, answer.headers.get("retry-after"))) is None:
                    return _accepted(answer)
            time.sleep(pause_s)

    def _redirected(
        self, method: str, url: str, headers: Mapping[str, str], body: bytes | None, followed: frozenset[int]
    ) -> Answer:
        for _ in range(MAX_REDIRECTS):
            answer = self._once(method, url, headers, body)
            if answer.status not in followed:
                return answer
            url = document_of(answer.location())
        raise BadAnswer(f"{url} redirects too often")

    def _once(self, method: str, url: str, headers: Mapping[str, str], body: bytes | None) -> Answer:
        self._check(url)
        with _translated(url), self.http.stream(method, url, headers=headers, content=body) as response:
            return Answer(str(response.url), response.status_code, response.headers, self.read_body(response))

    def _check(self, url: str) -> None:
        node: Node = URIRef(url)
        if not is_web(node):
            raise BadAnswer(f"{url[:200]!r} is not on the Web")
        if self.http.is_closed:
            raise Unreachable(f"{url} is not requested: the client is closed")

    def _recall(self, url: str) -> Document | None:
        with self._lock:
            if url in self._seen:
                self._seen.move_to_end(url)
            return self._seen.get(url)

    def _keep(self, url: str, document: Document) -> Document:
        with self._lock:
            self._seen[url] = document
            self._seen.move_to_end(url)
            while len(self._seen) > _KEPT:
                self._seen.popitem(last=False)
        return document


def parse_rdf(text: str, media_type: str, url: str) -> rdflib.Graph:
    """Parse RDF that was received from ``url``. Raises BadAnswer if it is invalid."""
    known = _FORMATS.get(media_type.partition(";")[0].strip().lower())
    if known is None:
        raise BadAnswer(
            f"{url} answers with {media_type or 'no media type'}, which is not an RDF media type that this client reads"
        )
    if _HUGE_NUMBER.search(text):
        raise BadAnswer(f"{url} has a number that is too large")
    try:
        return load(text, known, url)
    except (SyntaxError, ValueError) as error:
        raise BadAnswer(f"{url} is not valid {known}: {_first_line(error)}") from error


def _document(answer: Answer) -> Document:
    text = answer.body.decode("utf-8", errors="replace")
    graph = parse_rdf(text, answer.headers.get("content-type", ""), answer.url)
    return Document(answer.url, graph, answer.headers.get("etag"), _links(answer), hash(answer.body))


def _links(answer: Answer) -> tuple[tuple[str, str], ...]:
    found = []
    for target, parameters in re.findall(r"<([^>]*)>([^<]*)", answer.headers.get("link", "")):
        said = re.search(r';\s*rel\s*=\s*(?:"([^"]*)"|([^\s;,]+))', parameters)
        try:
            absolute = str(httpx.URL(answer.url).join(target))
        except httpx.InvalidURL:
            continue  # an invalid link; the others may be valid
        found += [(absolute, relation) for relation in (said.group(1) or said.group(2) or "").split()] if said else []
    return tuple(found)


def _accepted(answer: Answer) -> Answer:
    if answer.status >= 400:
        raise problem(answer.url, answer.status, answer.headers, answer.body)
    return answer


@contextmanager
def _translated(url: str) -> Iterator[None]:
    try:
        yield
    except httpx.TimeoutException as error:
        raise Unreachable(f"{url} does not answer in time") from error
    except (httpx.InvalidURL, httpx.TooManyRedirects, httpx.DecodingError, UnicodeError) as error:
        raise BadAnswer(f"{url[:200]!r}: {_first_line(error)}") from error
    except httpx.HTTPError as error:
        raise Unreachable(f"{url} cannot be reached: {_first_line(error)}") from error


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
