"""R0.9 to R0.11: links and header fields of resources."""

import re

from linked_fleet_client.conform.rdf import linkset, related
from linked_fleet_client.conform.subject import Subject
from linked_fleet_client.conform.verdict import Verdict, cant_tell, judged
from linked_fleet_client.conform.walk import Page, plain

_ETAG = re.compile(r'(?:W/)?"[\x21\x23-\x7e]*"')


async def r0_9(subject: Subject) -> Verdict:
    """A Robotic Thing must advertise associated sub-resources using the HTTP response Link header field, and a link
    relation type of related (that is, rel="related").
    """
    problems, count, by_linkset = [], 0, 0
    for page in subject.answering():
        named = {plain(node) for _, node in subject.walk.sub_resources(page)}
        expected = {url for url in named if subject.web.ours(url)}
        header = set(related(page.answer, "related"))
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
    return judged(problems, f'rel="related" for {count} sub-resources of {subject.extent()}{note}')


async def _in_link_sets(subject: Subject, page: Page) -> set[str]:
    """Return links from link sets (RFC 9264), which hold those that exceed the practical size of header fields."""
    found: set[str] = set()
    for url in related(page.answer, "linkset"):
        found.update(linkset((await subject.page(url)).answer, "related"))
    return found


async def r0_10(subject: Subject) -> Verdict:
    """A RT server must support OPTIONS for each of its exposed resources and must advertise permitted resource
    interactions in the response Allow header field.
    """
    problems = []
    for page in subject.answering():
        answer = await subject.options(page.url)
        if not answer.successful:
            problems.append(str(answer))
        elif "GET" not in answer.allow:
            problems.append(f"{answer}: Allow is {answer.header('allow') or 'absent'}, though GET answers")
    return judged(problems, f"OPTIONS answers with Allow on {subject.extent()}")


async def r0_11(subject: Subject) -> Verdict:
    """A RT server must use entity tags as response ETag header values for all responses that contain representations
    and for responses to HEAD requests.
    """
    problems: list[str] = []
    unchanged = 0
    for page in subject.answering():
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
    return judged(problems, f"ETag on GET and HEAD of {subject.extent()}; {unchanged} unchanged ones answered 304")
