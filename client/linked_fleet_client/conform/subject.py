"""The server under test: the resources found, its cached answers, and trial subscriptions, each deleted again."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from rdflib import URIRef

from linked_fleet_client.conform.channels import Delivery, Mailbox, Receiver, Stream, open_stream
from linked_fleet_client.conform.rdf import LDP, TURTLE, linked_iris
from linked_fleet_client.conform.walk import Page, Walk, plain, read
from linked_fleet_client.conform.web import Answer, Web, absolute

_OTHER_TYPES = ("application/ld+json", "application/n-triples", "application/rdf+xml")
_TIMEOUT_S = 5.0
_DOUBT_S = 1.0
"""Seconds to wait for the first delivery of a created subscription, and of one that may not exist."""
_POSTED = """\
@prefix hybrit: <{model}> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
<> a hybrit:Subscription, hybrit:WebCallback ;
    hybrit:onResource <{resource}> ;
    hybrit:callbackURL "{callback}"^^xsd:anyURI ;
    hybrit:mediaType "text/turtle" .
"""


@dataclass
class CallbackAttempt:
    """One attempt to create a callback. ``url`` is the subscription if this check certainly created it."""

    answer: Answer
    accept: str = ""
    url: str = ""
    description: Page | None = None
    allow: frozenset[str] = frozenset()
    delivery: Delivery | None = None
    deleted: Answer | None = None
    undeleted: str = ""

    @property
    def has_creation_status(self) -> bool:
        """True if the status alone says that a resource was created."""
        plain = self.answer.status == 200 and not self.answer.header("location")
        return self.answer.status == 101 or (self.answer.successful and not plain)

    @property
    def exists(self) -> bool:
        """True if the server created a subscription: it has a URL, or a delivery arrived."""
        return bool(self.url or self.delivery)


@dataclass
class Trials:
    """All attempts. ``excuse`` is the reason for not trying callbacks; attempts that are None were not made."""

    resource: str
    container: str
    other_type: str = ""
    streams: list[Stream] = field(default_factory=list)
    excuse: str = ""
    without_callback: CallbackAttempt | None = None
    plain: CallbackAttempt | None = None
    negotiated: CallbackAttempt | None = None
    posted: CallbackAttempt | None = None

    def callback_attempts(self) -> list[CallbackAttempt]:
        attempts = (self.without_callback, self.plain, self.negotiated, self.posted)
        return [attempt for attempt in attempts if attempt is not None]

    def opened_streams(self) -> list[Stream]:
        return [stream for stream in self.streams if not stream.fault]


def target(walk: Walk) -> tuple[str, str]:
    """Choose the resource to subscribe to, preferably a property, and its subscriptions container, if any."""
    for thing in walk.things():
        for node in walk.objects_in_role(thing, "property"):
            page = walk.pages.get(plain(node))
            if page and page.answer.successful:
                return page.url, _container(walk, thing)
    thing = walk.things()[0]
    return thing.url, _container(walk, thing)


def _container(walk: Walk, thing: Page) -> str:
    return next((plain(node) for node in walk.objects_in_role(thing, "subscriptions") if isinstance(node, URIRef)), "")


async def try_streams(web: Web, trials: Trials) -> None:
    for accept in _OTHER_TYPES:
        if not trials.other_type:
            answer = await web.request("GET", trials.resource, {"accept": accept})
            trials.other_type = accept if answer.successful and answer.media_type == accept else ""
    for accept in ("", trials.other_type) if trials.other_type else ("",):
        web.check_time()
        trials.streams.append(await open_stream(trials.resource, accept, web.timeout_s, web.credentials))


async def try_callbacks(web: Web, walk: Walk, trials: Trials, host: str) -> None:
    """Try callbacks with a receiver at ``host``."""
    receiver = Receiver(host)
    try:
        await receiver.start()
    except OSError as error:
        trials.excuse = f"no receiver can be opened at {host}: {error}"
        return
    try:
        await _Maker(web, walk, trials, receiver).all()
    finally:
        receiver.close()


class _Maker:
    def __init__(self, web: Web, walk: Walk, trials: Trials, receiver: Receiver) -> None:
        self._web, self._walk, self._trials, self._receiver = web, walk, trials, receiver

    async def all(self) -> None:
        trials = self._trials
        trials.without_callback = await self._upgraded(None, "")
        trials.plain = await self._upgraded(self._receiver.mailbox(), "")
        if trials.other_type:
            trials.negotiated = await self._upgraded(self._receiver.mailbox(), trials.other_type)
        if "POST" in (await self._web.request("OPTIONS", trials.container)).allow:
            trials.posted = await self._posted(self._receiver.mailbox())

    async def _upgraded(self, box: Mailbox | None, accept: str) -> CallbackAttempt:
        headers = {"connection": "Upgrade", "upgrade": "callback"}
        headers |= {"callback": box.url} if box else {}
        headers |= {"accept": accept} if accept else {}
        return await self._make("GET", self._trials.resource, headers, None, box)

    async def _posted(self, box: Mailbox) -> CallbackAttempt:
        body = _POSTED.format(model=self._walk.model, resource=self._trials.resource, callback=box.url)
        return await self._make("POST", self._trials.container, {"content-type": TURTLE}, body.encode(), box)

    async def _make(
        self, method: str, url: str, headers: Mapping[str, str], body: bytes | None, box: Mailbox | None
    ) -> CallbackAttempt:
        before = await self._members()
        made = CallbackAttempt(await self._web.request(method, url, headers, body), headers.get("accept", ""))
        try:
            if box and (made.has_creation_status or made.answer.successful):
                timeout_s = _TIMEOUT_S if made.has_creation_status else _DOUBT_S
                made.delivery = await box.wait_for_delivery(min(timeout_s, self._web.timeout_s))
        finally:
            await self._undo(made, box, before)
        return made

    async def _undo(self, made: CallbackAttempt, box: Mailbox | None, before: frozenset[str]) -> None:
        """Delete the created subscription, and nothing else, whatever the server claims."""
        named = absolute(made.answer.url, made.answer.header("location"))
        if not made.has_creation_status and not made.answer.successful and not made.delivery:
            return
        new = await self._members() - before
        for url in [named] if named else sorted(new):
            page = await read(self._web, url, in_any_case=True)
            if self._is_ours(page, bool(named) and url in new, box):
                made.url, made.description = url, page
                made.allow = (await self._web.request("OPTIONS", url, in_any_case=True)).allow
                made.deleted = await self._web.request("DELETE", url, in_any_case=True)
                return
        if made.has_creation_status or made.delivery:
            made.undeleted = named or "a subscription that no Location names"

    def _is_ours(self, page: Page, announced: bool, box: Mailbox | None) -> bool:
        if page.url in self._walk.pages or page.asked in self._walk.pages or not page.answer.successful:
            return False
        return announced or (box is not None and box.token.encode() in page.answer.body)

    async def _members(self) -> frozenset[str]:
        if not self._trials.container:
            return frozenset()
        container = await read(self._web, self._trials.container, in_any_case=True)
        return frozenset(plain(node) for node, predicate in linked_iris(container.graph) if predicate == LDP.contains)


@dataclass
class Subject:
    web: Web
    walk: Walk
    trials: Trials
    writes: bool
    _options: dict[str, Answer] = field(default_factory=dict)
    _read: dict[str, Page] = field(default_factory=dict)

    async def options(self, url: str) -> Answer:
        if url not in self._options:
            self._options[url] = await self.web.request("OPTIONS", url)
        return self._options[url]

    async def page(self, url: str) -> Page:
        """Return a page that a resource names, reading it if the walk did not reach it."""
        found = self.walk.pages.get(url) or self._read.get(url)
        if found is None:
            found = self._read[url] = await read(self.web, url)
        return found

    def readable_pages(self) -> list[Page]:
        return [page for page in self.walk if page.answer.successful]

    def extent(self) -> str:
        """Return the extent of the check as text, for evidence."""
        return f"{len(self.walk)} resources from {self.walk.root.url}"
