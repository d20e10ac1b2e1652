"""OpenTelemetry spans of commands and stops that an agent receives."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from linked_fleet_agent.spans import close_provider, open_provider, remote_context
from linked_fleet_agent.wire import traceparent
from linked_fleet_agent.wire.codec import decode_reply
from linked_fleet_agent.wire.messages import Refused

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider


class Tracing:
    """Records a span for each command and stop; ``close`` exports the remaining ones."""

    def __init__(self, provider: "TracerProvider") -> None:
        self._provider, self._tracer = provider, provider.get_tracer(__name__)

    def answer_in_span(
        self, kind: str, robot: str, parent: bytes | None, payload: bytes, answer: Callable[[bytes], bytes]
    ) -> bytes:
        """Call ``answer`` within a span and return its reply; ``parent`` is a W3C traceparent if it parses as one."""
        from opentelemetry.trace import SpanKind, Status, StatusCode

        attributes = {"linked_fleet.robot": robot}
        asking = None if parent is None else traceparent.parse(parent.decode("latin-1"))
        with self._tracer.start_as_current_span(
            f"take {kind}", context=remote_context(asking), kind=SpanKind.SERVER, attributes=attributes
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
        """Export the remaining spans, for a bounded time. Blocks."""
        close_provider(self._provider)


def open_tracing(environment: Mapping[str, str]) -> Tracing | None:
    """Return None if no collector is configured. Raises TracingUnavailable."""
    provider = open_provider(environment, {"service.name": "linked-fleet-agent"})
    return None if provider is None else Tracing(provider)
