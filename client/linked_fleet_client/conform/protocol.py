"""R0.1 to R0.11: HTTP and hypermedia of Robotic Thing servers.

R0.1 to R0.8 are basic HTTP, R0.9 to R0.11 links and header fields of resources.
"""

import ipaddress
import re
import socket
from urllib.parse import urlsplit

from rdflib import BNode, Literal

from linked_fleet_client.conform.rdf import SH, TURTLE, link_targets, linkset_targets
from linked_fleet_client.conform.subject import Subject
from linked_fleet_client.conform.verdict import (
    Level,
    Outcome,
    Verdict,
    cant_tell,
    failed,
    inapplicable,
    passed,
    verdict_on,
)
from linked_fleet_client.conform.walk import Page, plain
from linked_fleet_client.conform.web import Answer, exchange, status

_CLOSE = b"Connection: close\r\n\r\n"
_NO_HOST = b"GET {path} HTTP/1.1\r\n" + _CLOSE
_HEAD = b"HEAD {path} HTTP/1.1\r\nHost: {host}\r\n" + _CLOSE
_UNKNOWN_METHOD = b"CONFORM {path} HTTP/1.1\r\nHost: {host}\r\n" + _CLOSE
_BROKEN_TURTLE = b"<> <"
_NO_ETAG = '"none-that-any-resource-has"'
_GONE = (404, 410)
_PRIVATE = (401, 403)


async def r0_1(subject: Subject) -> Verdict:
    """A RT server must at least be HTTP/1.1 conformant server."""
    root = subject.walk.root
    if root.answer.version != "HTTP/1.1":
        return failed(f"{root.answer}: the answer is {root.answer.version or 'no HTTP'}, not HTTP/1.1")
    timeout_s = subject.web.timeout_s
    problems = []
    answer, _ = await exchange(root.url, _NO_HOST, timeout_s)
    if status(answer) != 400:
        problems.append(f"GET {root.url} without Host: {status(answer) or 'no answer'}, not 400")
    answer, fault = await exchange(root.url, _HEAD, timeout_s)
    _, blank, body = answer.partition(b"\r\n\r\n")
    if not status(answer) or not blank or fault:
        problems.append(f"HEAD {root.url}: {fault or 'no complete answer'}")
    elif body:
        problems.append(f"HEAD {root.url}: {len(body)} bytes of a body that must not be there")
    answer, _ = await exchange(root.url, _UNKNOWN_METHOD, timeout_s)
    if status(answer) < 400:
        problems.append(f"unknown method at {root.url}: {status(answer) or 'no answer'}, not an error")
    return verdict_on(
        problems, f"{root.answer} over HTTP/1.1; no Host is a 400, HEAD has no body, unknown methods are refused"
    )


async def r0_2(subject: Subject) -> Verdict:
    """A RT server should support secure connections with HTTP over TLS. RT servers that are exposed on the Internet
    must always implement HTTPS or other security mechanisms in addition or in place of HTTPS.
    """
    return security(subject.walk.root.url)


def security(url: str) -> Verdict:
    """Judge by the URL and the addresses of its host alone."""
    parts = urlsplit(url)
    if parts.scheme == "https":
        return passed(f"{url}: TLS with a certificate that is trusted here")
    addresses = _addresses(parts.hostname or "")
    if not addresses:
        return cant_tell(f"{url}: no address of {parts.hostname} is known here")
    if all(address.is_loopback for address in addresses):
        return inapplicable(f"{url}: plain HTTP that never leaves the machine")
    if any(address.is_global for address in addresses):
        return Verdict(Outcome.FAILED, f"{url}: plain HTTP at an address of the Internet", Level.MUST)
    return failed(f"{url}: plain HTTP in a private network")


def _addresses(host: str) -> list[ipaddress.IPv4Address | ipaddress.IPv6Address]:
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
        return [ipaddress.ip_address(str(entry[4][0]).partition("%")[0]) for entry in found]
    except (OSError, ValueError):
        return []


async def r0_3(subject: Subject) -> Verdict:
    """A Robotic Thing must have a URI endpoint for itself and all of its sub-resources."""
    problems = [
        f"GET {page.url}: the description does not speak of {page.url}"
        for page in subject.walk.things()
        if len(page.graph) and (page.node, None, None) not in page.graph
    ]
    if any(isinstance(node, BNode) for node in subject.walk.typed_nodes()):
        problems.append(f"{subject.extent()}: a Robotic Thing without URI")
    for page in subject.walk:
        for role, node in subject.walk.sub_resources(page):
            problems += [f"GET {page.url}: names a {role} without URI"] if isinstance(node, BNode | Literal) else []
    problems += [
        f"{page.answer}, linked from {page.found_on}" for page in subject.walk.claimed_pages() if _missing(page)
    ]
    named = {node for page in subject.walk for _, node in subject.walk.sub_resources(page)}
    if not problems and not named:
        return cant_tell(f"{subject.extent()} name no sub-resources")
    return verdict_on(
        problems, f"{subject.extent()} name {len(named)} sub-resources by URI; all that were visited are there"
    )


def _missing(page: Page) -> bool:
    return page.answer.status in _GONE


async def r0_4(subject: Subject) -> Verdict:
    """A RT server must support GET on its root resource."""
    answer = subject.walk.root.answer
    return passed(str(answer)) if answer.successful else failed(str(answer))


async def r0_5(subject: Subject) -> Verdict:
    """A RT server must support GET for retrieving resource representations, POST for resource creation, PUT for
    resource updates or state changes, and DELETE for resource removal.
    """
    problems = [
        str(page.answer)
        for page in subject.walk.claimed_pages()
        if not page.answer.successful and not _missing(page) and page.answer.status not in _PRIVATE
    ]
    allowed = {
        method: page.url for page in subject.readable_pages() for method in (await subject.options(page.url)).allow
    }
    telling = bool(allowed)
    for made in subject.trials.callback_attempts():
        allowed |= dict.fromkeys(made.allow, made.url) | ({"DELETE": made.url} if _gone(made.deleted) else {})
        if made.undeleted:
            problems.append(f"{made.undeleted} could not be deleted again")
    missing = [method for method in ("POST", "PUT", "DELETE") if method not in allowed]
    if missing and not problems:
        found = f"{', '.join(missing)} in no Allow field of {subject.extent()}"
        nothing_deleted = missing == ["DELETE"] and not any(made.url for made in subject.trials.callback_attempts())
        return cant_tell(found) if subject.walk.truncation_reason or nothing_deleted or not telling else failed(found)
    seen = ", ".join(f"{method} {allowed[method]}" for method in ("POST", "PUT", "DELETE") if method in allowed)
    return verdict_on(problems, f"GET answers on {subject.extent()}; allowed are {seen}")


def _gone(deleted: Answer | None) -> bool:
    return deleted is not None and deleted.successful


async def r0_6(subject: Subject) -> Verdict:
    """A RT server must implement HTTP status codes 200, 400 and 500 providing at least generic indications for
    successful actions, client-side errors or server-side errors.
    """
    problems = []
    if subject.walk.root.answer.status != 200:
        problems.append(f"{subject.walk.root.answer}, not 200")
    problems += [str(page.answer) for page in subject.walk if page.answer.status >= 500]
    answers = [await subject.web.request("GET", subject.trials.resource, {"accept": "application/x-none;q=banana"})]
    answers += await _broken_bodies(subject) if subject.writes else []
    bare = subject.trials.without_callback
    answers += [bare.answer] if bare else []
    problems += [f"{answer}: a server error for what the client did" for answer in answers if answer.status >= 500]
    refusals = [answer for answer in answers[1:] if answer.status]
    problems += [f"{answer}: accepts a body that is not Turtle" for answer in refusals if _accepts_nonsense(answer)]
    if not problems and not any(400 <= answer.status < 500 for answer in refusals):
        return cant_tell("200 was seen; no harmless wrong request was found")
    seen = ", ".join(sorted({str(answer.status) for answer in refusals}))
    return verdict_on(
        problems, f"200 for what is there, {seen} for what is wrong; a 500 cannot be provoked from outside"
    )


def _accepts_nonsense(answer: Answer) -> bool:
    return answer.method != "GET" and answer.successful


async def _broken_bodies(subject: Subject) -> list[Answer]:
    """Send invalid requests: bodies that are not Turtle.

    An action also gets an If-Match that no resource has, and must require input. Only one request of each kind is sent,
    because a server may fail to check the body.
    """
    answers = []
    containers: list[tuple[str, dict[str, str]]] = [
        (page.url, {}) for page in subject.walk.pages_in_role("subscriptions")[:1]
    ]
    actions = [
        (page.url, {"if-match": _NO_ETAG}) for page in subject.walk.pages_in_role("action") if _demands(subject, page)
    ][:1]
    for url, guard in [*containers, *actions]:
        allow = (await subject.options(url)).allow
        for method in [name for name in ("POST", "PUT") if name in allow]:
            headers = {"content-type": TURTLE, **guard}
            answers.append(await subject.web.request(method, url, headers, _BROKEN_TURTLE))
    return answers


def _demands(subject: Subject, page: Page) -> bool:
    """Return True if an action requires input."""
    shapes = list(page.graph.objects(page.node, subject.walk.model.consumes))
    counts = [count for shape in shapes for count in page.graph.objects(shape, SH.property / SH.minCount)]
    return any(isinstance(count, Literal) and isinstance(count.value, int) and count.value > 0 for count in counts)


async def r0_7(subject: Subject) -> Verdict:
    """A RT server should return a HTTP status code 204 for all successful PUT, POST, and DELETE requests."""
    answers = [made.deleted for made in subject.trials.callback_attempts() if made.deleted is not None]
    answers += [made.answer for made in subject.trials.callback_attempts() if made.answer.method == "POST"]
    successful = [answer for answer in answers if answer.successful]
    if not successful:
        return cant_tell(subject.trials.excuse or "no harmless PUT, POST or DELETE succeeded")
    other = sorted({f"{answer}, not 204" for answer in successful if answer.status != 204})
    note = " (LDP asks for 201 where a container makes a member)" if any(a.status == 201 for a in successful) else ""
    verdict = verdict_on(
        other, f"204 to {len(successful)} requests, the last {successful[-1].method} {successful[-1].url}"
    )
    return Verdict(verdict.outcome, verdict.evidence + note)


async def r0_8(subject: Subject) -> Verdict:
    """A RT server must use the response Location header field to provide information about the location of a newly
    created resource for all successful POST requests.
    """
    made = subject.trials.posted
    if made is None or not made.answer.successful:
        reason = subject.trials.excuse or "no container takes a POST that could be undone"
        return cant_tell(f"{made.answer}: a harmless POST was refused" if made else reason)
    location = made.answer.header("location")
    if not location:
        return failed(f"{made.answer}: no Location field")
    if not made.url:
        return failed(f"{made.answer}: Location {location} leads to nothing that was created")
    return passed(f"{made.answer}: Location {location}")


_ETAG = re.compile(r'(?:W/)?"[\x21\x23-\x7e]*"')


async def r0_9(subject: Subject) -> Verdict:
    """A Robotic Thing must advertise associated sub-resources using the HTTP response Link header field, and a link
    relation type of related (that is, rel="related").
    """
    problems, count, by_linkset = [], 0, 0
    for page in subject.readable_pages():
        named = {plain(node) for _, node in subject.walk.sub_resources(page)}
        expected = {url for url in named if subject.web.same_origin(url)}
        header = set(link_targets(page.answer, "related"))
        missing = expected - header
        if missing and header:
            missing -= await _in_link_sets(subject, page)
            by_linkset += not missing
        count += len(expected)
        if missing:
            what = "no" if not header else "not every"
            problems.append(f'GET {page.url}: Link has {what} sub-resource as rel="related", such as {min(missing)}')
    if not count:
        return cant_tell(f"{subject.extent()} name no sub-resources")
    note = f"; of {by_linkset} resources some stand in the link set only that Link names" if by_linkset else ""
    return verdict_on(problems, f'rel="related" for {count} sub-resources of {subject.extent()}{note}')


async def _in_link_sets(subject: Subject, page: Page) -> set[str]:
    """Return links from link sets (RFC 9264), which hold those that exceed the practical size of header fields."""
    found: set[str] = set()
    for url in link_targets(page.answer, "linkset"):
        found.update(linkset_targets((await subject.page(url)).answer, "related"))
    return found


async def r0_10(subject: Subject) -> Verdict:
    """A RT server must support OPTIONS for each of its exposed resources and must advertise permitted resource
    interactions in the response Allow header field.
    """
    problems = []
    for page in subject.readable_pages():
        answer = await subject.options(page.url)
        if not answer.successful:
            problems.append(str(answer))
        elif "GET" not in answer.allow:
            problems.append(f"{answer}: Allow is {answer.header('allow') or 'absent'}, though GET answers")
    return verdict_on(problems, f"OPTIONS answers with Allow on {subject.extent()}")


async def r0_11(subject: Subject) -> Verdict:
    """A RT server must use entity tags as response ETag header values for all responses that contain representations
    and for responses to HEAD requests.
    """
    problems: list[str] = []
    unchanged = 0
    for page in subject.readable_pages():
        tag = page.answer.header("etag")
        if not _ETAG.fullmatch(tag):
            problems.append(f"GET {page.url}: ETag is {tag or 'absent'}")
            continue
        head = await subject.web.request("HEAD", page.url)
        if not head.successful or not _ETAG.fullmatch(head.header("etag")):
            problems.append(f"{head}: ETag is {head.header('etag') or 'absent'}")
        again = await subject.web.request("GET", page.url, {"if-none-match": tag})
        unchanged += again.status == 304
        if again.status != 304 and again.header("etag") == tag:
            problems.append(f"{again}: not 304, though If-None-Match has the very tag {tag}")
    return verdict_on(problems, f"ETag on GET and HEAD of {subject.extent()}; {unchanged} unchanged ones answered 304")
