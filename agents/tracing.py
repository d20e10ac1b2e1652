"""Spans of what an agent is told, by OpenTelemetry, which is imported only where the environment asks for it."""

import logging
import threading
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from agents.wire import traceparent
from agents.wire.codec import decode_reply
from agents.wire.messages import Refused

if TYPE_CHECKING:
    from opentelemetry.context import Context
    from opentelemetry.sdk.trace import TracerProvider

_log = logging.getLogger(__name__)
_LAST_EXPORT_S = 1.5
_COMPLAINT_PERIOD_S = 60.0


class TracingUnavailableError(Exception):
    """Spans are asked for and their packages are not there; one line for a human."""


class Tracing:
    """Records what is taken; ``close`` sends what is left."""

    def __init__(self, provider: "TracerProvider") -> None:
        self._provider, self._tracer = provider, provider.get_tracer(__name__)

    def take(
        self, kind: str, robot: str, parent: bytes | None, payload: bytes, answer: Callable[[bytes], bytes]
    ) -> bytes:
        """What ``answer`` replies, in a span; ``parent`` is a traceparent, perhaps."""
        from opentelemetry.trace import SpanKind, Status, StatusCode

        attributes = {"linked_fleet.robot": robot}
        with self._tracer.start_as_current_span(
            f"take {kind}", context=_context(parent), kind=SpanKind.SERVER, attributes=attributes
        ) as span:
            written = answer(payload)
            reply = decode_reply(written)
            if reply.id:
                span.set_attribute("linked_fleet.command", reply.id)
            span.set_attribute("linked_fleet.outcome", "refused" if isinstance(reply, Refused) else "accepted")
            if isinstance(reply, Refused):
                span.set_attribute("error.type", reply.code)
                span.set_status(Status(StatusCode.ERROR, reply.reason))
            return written

    def close(self) -> None:
        """Send what is left, for as long as a process that ends can wait. Blocks."""
        ending = threading.Thread(target=self._provider.shutdown, name="last spans", daemon=True)
        ending.start()
        ending.join(_LAST_EXPORT_S)
        if ending.is_alive():
            _log.warning("the collector does not take the last spans; they are lost")


def open_tracing(environment: Mapping[str, str]) -> Tracing | None:
    """None where the environment names no collector, or has OTEL_SDK_DISABLED; TracingUnavailableError."""
    names = ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT")
    named = next((name for name in names if environment.get(name)), None)
    if named is None or environment.get("OTEL_SDK_DISABLED", "").strip().lower() == "true":
        return None
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.resources import OTELResourceDetector, Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ImportError as error:
        raise TracingUnavailableError(
            f"{named} is set, but what traces is not installed ({error}): pip install 'linked-fleet[tracing]'"
        ) from error
    logging.getLogger(OTLPSpanExporter.__module__).addFilter(_Seldom())
    own = Resource.create({"service.name": "linked-fleet-agent"}).merge(OTELResourceDetector().detect())
    provider = TracerProvider(resource=own, shutdown_on_exit=False)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    return Tracing(provider)


class _Seldom(logging.Filter):
    """Lets the exporter complain once a minute, however many spans a collector that is away does not take."""

    _next_s = 0.0

    def filter(self, record: logging.LogRecord) -> bool:
        now_s = time.monotonic()
        if now_s < self._next_s:
            return False
        self._next_s = now_s + _COMPLAINT_PERIOD_S
        return True


def _context(parent: bytes | None) -> "Context":
    """That of the span which asks; an empty one if there is none."""
    from opentelemetry.context import Context
    from opentelemetry.trace import NonRecordingSpan, SpanContext, TraceFlags, set_span_in_context

    asking = None if parent is None else traceparent.parse(parent.decode("latin-1"))
    if asking is None:
        return Context()
    flags = TraceFlags(TraceFlags.SAMPLED if asking.sampled else TraceFlags.DEFAULT)
    remote = SpanContext(asking.trace_id, asking.span_id, is_remote=True, trace_flags=flags)
    return set_span_in_context(NonRecordingSpan(remote), Context())
