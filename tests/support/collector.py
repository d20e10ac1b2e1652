"""A collector of trace spans: receives OTLP over HTTP with a real receiver."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest
from opentelemetry.proto.trace.v1 import trace_pb2

from receivers import Answer, CallbackReceiver, receiving
from running import eventually

_PATH = "/v1/traces"


@dataclass(frozen=True)
class Span:
    """Ids in hexadecimal; ``kind`` and ``failed`` as in the protocol."""

    service: str
    name: str
    kind: str
    trace: str
    id: str
    parent: str
    failed: bool
    said: dict[str, str | int]


class Collector:
    def __init__(self, receiver: CallbackReceiver) -> None:
        self.receiver = receiver

    def spans(self) -> list[Span]:
        """Return all spans received so far."""
        return [span for seen in self.receiver.log(_PATH, "POST") for span in _spans(seen.body)]

    @contextlib.contextmanager
    def named(self) -> Iterator[None]:
        """Let processes that are started in this context send their spans here."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", self.receiver.url("").rstrip("/"))
            patch.setenv("OTEL_BSP_SCHEDULE_DELAY", "50")
            yield

    def trace(self, id: str, *names: str) -> dict[str, Span]:
        """Return the spans of this trace by name, once those with these names have arrived.

        An agent may process one stop twice: a gateway repeats the request if there is no reply within 50 ms.
        """

        def probe() -> dict[str, Span] | None:
            of = [span for span in self.spans() if span.trace == id]
            named = {span.name: span for span in of}
            once = [span for span in of if span.name != "take stop"]
            assert len({span.name for span in once}) == len(once), f"two of one name in {of}"
            return named if named.keys() >= set(names) else None

        return eventually(probe, f"{names} in trace {id}")


@contextlib.contextmanager
def collecting() -> Iterator[Collector]:
    with receiving() as receiver:
        receiver.default = Answer(200)
        yield Collector(receiver)


def _spans(body: bytes) -> Iterator[Span]:
    for resource in ExportTraceServiceRequest.FromString(body).resource_spans:
        (service,) = [each.value.string_value for each in resource.resource.attributes if each.key == "service.name"]
        for span in (each for scope in resource.scope_spans for each in scope.spans):
            said = {each.key: each.value.string_value or each.value.int_value for each in span.attributes}
            kind = trace_pb2.Span.SpanKind.Name(span.kind).removeprefix("SPAN_KIND_").lower()
            failed = span.status.code == trace_pb2.Status.STATUS_CODE_ERROR
            ids = (span.trace_id.hex(), span.span_id.hex(), span.parent_span_id.hex())
            yield Span(service, span.name, kind, *ids, failed, said)
