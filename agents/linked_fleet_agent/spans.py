"""Export of OpenTelemetry spans. OpenTelemetry is imported only if the environment enables it."""

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


class TracingUnavailable(Exception):  # noqa: N818 -- named like the other outcomes
    """Spans are enabled but the OpenTelemetry packages are missing; the message is one line."""


def open_provider(environment: Mapping[str, str], own: dict[str, str]) -> "TracerProvider | None":
    """Return a tracer provider, or None if no collector is configured or OTEL_SDK_DISABLED is set.

    ``own`` holds resource attributes of the process (OpenTelemetry semantic conventions); the environment overrides
    them. Raises TracingUnavailable.
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
            f"{named} is set, but OpenTelemetry is not installed ({error}): pip install 'linked-fleet-agent[tracing]'"
        ) from error
    logging.getLogger(OTLPSpanExporter.__module__).addFilter(_RateLimit())
    resource = Resource.create(own).merge(OTELResourceDetector().detect())
    provider = TracerProvider(resource=resource, shutdown_on_exit=False)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    return provider


def close_provider(provider: "TracerProvider") -> None:
    """Export the remaining spans, for ``_LAST_EXPORT_S`` at most. Blocks."""
    ending = threading.Thread(target=provider.shutdown, name="last spans", daemon=True)
    ending.start()
    ending.join(_LAST_EXPORT_S)
    if ending.is_alive():
        _log.warning("the collector does not take the last spans; they are lost")


def remote_context(asking: TraceParent | None) -> "Context":
    """Return the context of the remote parent span; an empty context if there is none."""
    from opentelemetry.context import Context
    from opentelemetry.trace import NonRecordingSpan, SpanContext, TraceFlags, set_span_in_context

    if asking is None:
        return Context()
    flags = TraceFlags(TraceFlags.SAMPLED if asking.sampled else TraceFlags.DEFAULT)
    remote = SpanContext(asking.trace_id, asking.span_id, is_remote=True, trace_flags=flags)
    return set_span_in_context(NonRecordingSpan(remote), Context())


class _RateLimit(logging.Filter):
    """Limits log records of the exporter to one a minute, however many spans an absent collector loses."""

    _next_s = 0.0

    def filter(self, record: logging.LogRecord) -> bool:
        now_s = time.monotonic()
        if now_s < self._next_s:
            return False
        self._next_s = now_s + _COMPLAINT_PERIOD_S
        return True
