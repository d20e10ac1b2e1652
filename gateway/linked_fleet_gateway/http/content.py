"""Responses with content that an extension has made itself: entity tags, preconditions and content codings."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from starlette.responses import Response

from linked_fleet_base.errors import PreconditionFailed
from linked_fleet_gateway.http.negotiation import coded_tag, compress, is_compressible, preferred_coding
from linked_fleet_gateway.http.read import READ_METHODS, accepted_codings, method_headers, resource_headers
from linked_fleet_gateway.http.representation import etag, not_modified, precondition_holds
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.resource import Resource

_OF_CONTENT = ("content-type", "content-length")


@dataclass(frozen=True)
class Content:
    """Bytes with their strong entity tag; ``coded`` are the same in gzip, or empty."""

    body: bytes
    etag: str
    coded: bytes = b""

    @classmethod
    def of(cls, body: bytes) -> Self:
        """Return the content with its tag, and in gzip unless it is short. Call it in a thread for long ones."""
        coded = compress(body) if is_compressible(body, measured=False, max_bytes=len(body)) else b""
        return cls(body, etag(body), coded)

    @staticmethod
    def headers(request: Request, resource: Resource, media_type: str) -> dict[str, str]:
        """Return the fields of a response to GET of the resource in a media type, apart from its entity tag."""
        headers = resource_headers(resource, request.base, "") | method_headers(resource, READ_METHODS)
        del headers["etag"]
        return headers | {"content-type": media_type}

    @property
    def size(self) -> int:
        """Number of bytes in memory."""
        return len(self.body) + len(self.coded)

    def response(self, request: Request, headers: Mapping[str, str]) -> Response:
        """Return the content, in gzip if the client prefers that, or 304. Raises PreconditionFailed."""
        coding = preferred_coding(accepted_codings(request), ("gzip",) if self.coded else ())
        tagged = {**headers, "etag": coded_tag(self.etag, coding)}
        if (known := self.known(request, tagged, self.etag)) is not None:
            return known
        if coding:
            return Response(self.coded, headers=tagged | {"content-encoding": coding})
        return Response(self.body, headers=tagged)

    @staticmethod
    def known(request: Request, headers: Mapping[str, str], etag: str = "") -> Response | None:
        """Return 304 if the client has the content with the entity tag in ``headers`` already, else None.

        ``etag`` is that of the content without coding, if it has another. Raises PreconditionFailed.
        """
        plain = etag or headers["etag"]
        if not precondition_holds(request.field("if-match"), {plain}):
            raise PreconditionFailed(f"The entity tag of the present content is {plain}.")
        if not not_modified(request.field("if-none-match"), headers["etag"]):
            return None
        return Response(status_code=304, headers={name: headers[name] for name in headers if name not in _OF_CONTENT})
