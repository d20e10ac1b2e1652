"""Control of a robot: its lease is taken, renewed while a block runs, and given back at its end."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from types import TracebackType

from rdflib import Graph
from rdflib.term import Literal, URIRef

from linked_fleet_client.errors import BadAnswer, ClientError, Controlled, ControlLost, Problem
from linked_fleet_client.resource import Resource
from linked_fleet_client.retry import Repeat
from linked_fleet_client.vocabulary import DCTERMS, LF, RDFS, XSD, is_web
from linked_fleet_client.web import Answer, HeldControl, Web, origin

DURATION_S = 30.0
"""A lease ends after this time, unless it is renewed: so long others wait for a client that has vanished."""
_RENEWALS = 3  # in the time of a lease
_TRIES = 4  # in the time between two renewals, while the server cannot be reached
_LOST = frozenset({409, 412, 423})
_MOST_ABOVE = 8


class Control:
    """The control lease of one robot, as a context manager. Its lock token goes with the robot's actions meanwhile."""

    def __init__(self, robot: Resource, lease: str, holder: str, duration_s: float = DURATION_S) -> None:
        self.robot, self.iri, self.holder, self.duration_s = robot, URIRef(lease), holder, duration_s
        self.token = ""
        self.until_s = 0.0
        """Monotonic time at which the lease ends unless it is renewed."""
        self._web: Web = robot.web
        self._lost: str | None = None
        self._closing = threading.Event()
        self._renewing = threading.Thread(target=self._renew_repeatedly, name=f"renew {lease}", daemon=True)

    def __enter__(self) -> Control:
        """Take the lease. Raises Controlled if another client has it."""
        began_s = time.monotonic()
        self.token = self._put({}, None)
        self.until_s = began_s + self.duration_s
        self._web.controls.update(dict.fromkeys(self._names(), self))
        self._renewing.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Give the lease back. Raises ControlLost if it was lost, unless the block has raised an error itself."""
        self._closing.set()
        self._renewing.join()
        for iri in self._names():
            self._web.controls.pop(iri, None)
        try:
            self.check()
            self._delete()
        except ClientError as failed:
            if error is None:
                raise
            if not isinstance(error, ControlLost):
                error.add_note(str(failed))

    def check(self) -> None:
        """Check that the lease is held. Raises ControlLost if it has ended or another client has it."""
        if self._lost is None and time.monotonic() >= self.until_s:
            self._lost = "it could not be renewed in time"
        if self._lost is not None:
            raise ControlLost(f"Control of {self.robot.name} is lost: {self._lost}")

    def send(self, method: str, url: str, body: bytes | None, headers: dict[str, str]) -> Answer:
        """Send the request of a motion with the lock token, which no other server gets.

        Raises ControlLost if the lease has ended or another client has it.
        """
        self.check()
        proof = self.proof if origin(url) == origin(self.iri) else {}
        try:
            return self._web.send(method, url, body, {**headers, **proof})
        except Problem as problem:
            if isinstance(problem, Controlled) or problem.status in (412, 423):
                self._lose(problem)
            raise

    def renew(self) -> None:
        """Renew the lease. Raises ControlLost if it is held no more; other errors leave that open."""
        began_s = time.monotonic()
        try:
            token = self._put(self.proof, Repeat.NEVER)
        except Problem as problem:
            if 400 <= problem.status < 500 and problem.status != 429:
                self._lose(problem)
            raise
        if token != self.token:  # that of a new lease, because the one before has ended
            self._lost, self.token = "it has ended before it was renewed", token
            self._delete()
            self.check()
        self.until_s = began_s + self.duration_s

    def _names(self) -> set[str]:
        return {str(self.robot.iri), str(self.robot.node)}

    @property
    def proof(self) -> dict[str, str]:
        """The field of a request by which its client is known to have control."""
        return {"lock-token": self.token}

    def _lose(self, problem: Problem) -> None:
        self._lost = f"the server says {problem}"
        try:
            self.check()
        except ControlLost as lost:
            raise lost from problem

    def _put(self, headers: dict[str, str], repeat: Repeat | None) -> str:
        graph = Graph()
        graph.add((self.iri, LF.holder, Literal(self.holder)))
        graph.add((self.iri, LF.leaseDuration, Literal(repr(float(self.duration_s)), datatype=XSD.double)))
        body = graph.serialize(format="turtle").encode()
        answer = self._web.send("PUT", self.iri, body, {"content-type": "text/turtle", **headers}, repeat)
        token = str(answer.headers.get("lock-token", ""))
        if not token:
            raise BadAnswer(f"{self.iri} grants a lease without a Lock-Token field")
        return token

    def _delete(self) -> None:
        try:
            self._web.send("DELETE", self.iri, None, self.proof)
        except Problem as problem:
            if problem.status in (404, *_LOST):
                self._lose(problem)
            raise

    def _renew_repeatedly(self) -> None:
        pause_s = self.duration_s / _RENEWALS
        while not self._closing.wait(pause_s):
            try:
                self.renew()
                pause_s = self.duration_s / _RENEWALS
            except ControlLost:
                return
            except ClientError:  # it may be renewed later; ``check`` finds when it is too late
                pause_s = self.duration_s / _RENEWALS / _TRIES


def control_of(action: Resource) -> HeldControl | None:
    """Return the control that this client has of the robot of an action, if any."""
    controls = action.web.controls
    return next((controls[iri] for iri in _above(action) if iri in controls), None) if controls else None


def _above(resource: Resource) -> Iterator[str]:
    """Yield the things that a resource was found by, then those that its description and theirs link as above it."""
    here = resource.owner
    while here is not None:
        yield str(here.iri)
        here = here.owner
    pending, seen = [str(resource.iri)], set[str]()
    while pending and len(seen) < _MOST_ABOVE:
        iri = pending.pop(0)
        if iri in seen:
            continue
        yield iri
        seen.add(iri)
        try:
            document = resource.web.get(iri)
        except Problem:
            continue  # what cannot be read leads no further
        graph, node = document.graph, document.iri(iri)
        linked = [*graph.objects(node, DCTERMS.isPartOf), *graph.objects(node, RDFS.seeAlso)]
        pending += [str(each) for each in linked if is_web(each)]
