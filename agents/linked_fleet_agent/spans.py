"""How spans leave a process, by OpenTelemetry, which is imported only where the environment asks for it."""

import logging
import threading
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING

from linked_fleet_agent.wire.traceparent import TraceParent

if TYPE_CHECKING:
    from opentelemetry.context import Context
    from opentelemetry.sdk.trace import TracerProvider

_log = logging.getLogger(__name__)
_LAST_EXPORT_S = 1.5
_COMPLAINT_PERIOD_S = 60.0


class TracingUnavailable(Exception):  # noqa: N818 -- as the other outcomes are called
    """Spans are asked for and their packages are not there; one line for a human."""


def open_provider(environment: Mapping[str, str], own: dict[str, str]) -> "TracerProvider | None":
    """None where the environment names no collector, or has OTEL_SDK_DISABLED; TracingUnavailable.

    ``own``: attributes of the process, by the semantic conventions for resources, unless the environment has others.
    """
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
        raise TracingUnavailable(
            f"{named} is set, but what traces is not installed ({error}): pip install 'linked-fleet-agent[tracing]'"
        ) from error
    logging.getLogger(OTLPSpanExporter.__module__).addFilter(_Seldom())
    resource = Resource.create(own).merge(OTELResourceDetector().detect())
    provider = TracerProvider(resource=resource, shutdown_on_exit=False)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    return provider


def close_provider(provider: "TracerProvider") -> None:
    """Send what is left, for as long as a process that ends can wait. Blocks."""
    ending = threading.Thread(target=provider.shutdown, name="last spans", daemon=True)
    ending.start()
    ending.join(_LAST_EXPORT_S)
    if ending.is_alive():
        _log.warning("the collector does not take the last spans; they are lost")


def within(asking: TraceParent | None) -> "Context":
    """That of the span which asks, in another process; an empty one if there is none."""
    from opentelemetry.context import Context
    from opentelemetry.trace import NonRecordingSpan, SpanContext, TraceFlags, set_span_in_context

    if asking is None:
        return Context()
    flags = TraceFlags(TraceFlags.SAMPLED if asking.sampled else TraceFlags.DEFAULT)
    remote = SpanContext(asking.trace_id, asking.span_id, is_remote=True, trace_flags=flags)
    return set_span_in_context(NonRecordingSpan(remote), Context())


class _Seldom(logging.Filter):
    """Lets the exporter complain once a minute, however many spans a collector that is away does not take."""

    _next_s = 0.0

    def filter(self, record: logging.LogRecord) -> bool:
        now_s = time.monotonic()
        if now_s < self._next_s:
            return False
        self._next_s = now_s + _COMPLAINT_PERIOD_S
        return True
