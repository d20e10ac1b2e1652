"""R0.12 to R0.17: subscriptions, checked by creating and deleting some."""

import json

from rdflib import RDF

from linked_fleet_client.conform.channels import Stream
from linked_fleet_client.conform.rdf import parse_turtle
from linked_fleet_client.conform.subject import CallbackAttempt, Subject
from linked_fleet_client.conform.verdict import Verdict, cant_tell, failed, passed, verdict_on

_NOT_HERE = (403, 422, 429, 503)
"""Statuses of a refusal because of the receiver, of quotas, or of the moment."""


async def r0_12(subject: Subject) -> Verdict:
    """A RT server must implement the WebSocket protocol [10]."""
    opened = subject.trials.opened_streams()
    if not opened:
        return _no_stream(subject)
    silent = [f"WebSocket {stream.url}: a ping is not answered" for stream in opened if not stream.ponged]
    return verdict_on(silent, f"WebSocket {opened[0].url}: opened, ping answered, closed")


def _no_stream(subject: Subject) -> Verdict:
    streams = subject.trials.streams
    return failed(f"WebSocket {streams[0].url}: {streams[0].fault}") if streams else cant_tell("no WebSocket was tried")


async def r0_13(subject: Subject) -> Verdict:
    """A RT server should implement a HTTP callback mechanism, e.g. WebHooks or RestHooks."""
    made = [each for each in subject.trials.callback_attempts() if each.exists]
    if made:
        return passed(f"{made[0].answer}: {_what_came(made[0])}")
    for page in subject.walk:
        if (None, RDF.type, subject.walk.model.WebCallback) in page.graph:
            return passed(f"GET {page.url}: lists callbacks")
    return _no_callback(subject)


def _what_came(made: CallbackAttempt) -> str:
    delivered = f", {made.delivery.media_type} was delivered" if made.delivery else ""
    deleted = f", deleted again ({made.deleted.status})" if made.deleted else ""
    return f"subscription {made.url or 'without URL'}{delivered}{deleted}"


def _no_callback(subject: Subject) -> Verdict:
    if subject.trials.excuse:
        return cant_tell(subject.trials.excuse)
    if subject.trials.plain is None:
        return cant_tell("no callback was tried")
    answer = subject.trials.plain.answer
    if answer.status in _NOT_HERE:
        return cant_tell(f"{answer}: refused, perhaps because of the receiver; set --callback-host")
    if subject.trials.plain.undeleted:
        return cant_tell(f"{answer}: no sign that {subject.trials.plain.undeleted} was made, and no delivery")
    return failed(f"{answer}: Upgrade: callback makes no subscription")


async def r0_14(subject: Subject) -> Verdict:
    """A RT server must support the request Upgrade header field for subscription creation."""
    opened, made = subject.trials.opened_streams(), subject.trials.plain
    by = ["websocket"] if opened else []
    by += ["callback"] if made and made.exists else []
    if by:
        return passed(f"GET {subject.trials.resource} with Upgrade: {' and '.join(by)}")
    return _no_stream(subject) if subject.trials.streams else _no_callback(subject)


async def r0_15(subject: Subject) -> Verdict:
    """A request Upgrade header field value of 'websocket' must result in the creation of a WebSocket-based
    communication as specified in [10].
    """
    opened = subject.trials.opened_streams()
    if not opened:
        return _no_stream(subject)
    size = (
        f"the first message has {len(opened[0].message)} bytes" if opened[0].message is not None else "no message yet"
    )
    return passed(f"WebSocket {opened[0].url}: 101, {size}")


async def r0_16(subject: Subject) -> Verdict:
    """A request Upgrade header field value of 'callback' must result in the creation of a HTTP callback, and requires
    the request Callback header field to specify a callback URI.
    """
    bare, made = subject.trials.without_callback, subject.trials.plain
    if bare and bare.has_creation_status:
        return failed(f"{bare.answer}: Upgrade: callback without Callback field is accepted")
    if made is None or not made.exists:
        return _no_callback(subject)
    return passed(f"{made.answer}: {_what_came(made)}")


async def r0_17(subject: Subject) -> Verdict:
    """A RT server should support the Accept header field in subscription creation requests to allow for
    content-negotiation.
    """
    trials = subject.trials
    if not trials.other_type:
        return cant_tell(f"GET {trials.resource}: no media type other than Turtle is offered")
    heard = [_of_stream(stream) for stream in trials.opened_streams() if stream.accept and stream.message is not None]
    heard += _of_callback(subject) if trials.negotiated else []
    if not heard:
        return cant_tell(f"{trials.resource}: no message came that would show its type")
    wrong = [problem for problem in heard if problem]
    return verdict_on(
        wrong, f"{trials.resource}: {len(heard)} subscriptions with Accept: {trials.other_type} get that type"
    )


def _of_stream(stream: Stream) -> str:
    """Return an error in the form of the first message; empty if there is none."""
    message = stream.message or b""
    if stream.accept == "application/ld+json":
        right = _is_json(message)
    elif stream.accept == "application/rdf+xml":
        right = message.lstrip().startswith(b"<?xml") or b"<rdf:RDF" in message
    else:
        right = b"@prefix" not in message and not parse_turtle(message, stream.url)[1]
    return "" if right else f"WebSocket {stream.url} with Accept: {stream.accept}: the message is something else"


def _is_json(message: bytes) -> bool:
    try:
        return isinstance(json.loads(message), dict | list)
    except (ValueError, RecursionError):
        return False


def _of_callback(subject: Subject) -> list[str]:
    """Return one error, or one empty string if the type is right; an empty list if undecided."""
    made = subject.trials.negotiated
    if made is None or not made.exists:
        return []
    if made.delivery:
        right = made.delivery.media_type == made.accept
        return ["" if right else f"{made.answer}: with Accept: {made.accept}, {made.delivery.media_type} is delivered"]
    graph = made.description.graph if made.description else None
    stated = {str(value) for value in graph.objects(None, subject.walk.model.mediaType)} if graph else set()
    return ["" if made.accept in stated else f"{made.url}: is for {min(stated)}, not {made.accept}"] if stated else []
