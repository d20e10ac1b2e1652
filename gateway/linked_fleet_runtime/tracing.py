"""OpenTelemetry spans of requests. OpenTelemetry is imported only if the environment enables it."""

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from types import TracebackType
from typing import TYPE_CHECKING, Self

from linked_fleet_agent.spans import close_provider, open_provider, remote_context
from linked_fleet_agent.wire import traceparent
from linked_fleet_agent.wire.messages import Refused, Reply
from linked_fleet_agent.wire.traceparent import TraceParent

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.trace import Span, Tracer


class ChildSpan:
    """A span within that of a request, as a context manager; an exception that leaves it sets its error status."""

    def __init__(self, span: "Span") -> None:
        self._span = span

    @property
    def traceparent(self) -> bytes:
        """The traceparent for an agent, whose span becomes a child of this one."""
        own = self._span.get_span_context()
        return str(TraceParent(own.trace_id, own.span_id, own.trace_flags.sampled)).encode()

    def record_reply(self, reply: Reply | None) -> None:
        """Record the reply of the agent; None means that there was none."""
        outcome = "silent" if reply is None else "refused" if isinstance(reply, Refused) else "accepted"
        self._span.set_attribute("linked_fleet.outcome", outcome)
        if isinstance(reply, Refused):
            self._fail(reply.code, reply.reason)
        elif reply is None:
            self._fail(outcome, "the agent gave no answer")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._fail(type(error).__name__, str(error))
        self._span.end()

    def _fail(self, kind: str, reason: str) -> None:
        from opentelemetry.trace import Status, StatusCode

        self._span.set_attribute("error.type", kind)
        self._span.set_status(Status(StatusCode.ERROR, reason))


class Trace:
    """The span of one request, with attributes by the semantic conventions for HTTP servers."""

    def __init__(self, tracer: "Tracer", span: "Span", method: str) -> None:
        self._tracer, self._span, self._method = tracer, span, method

    @property
    def id(self) -> str:
        return f"{self._span.get_span_context().trace_id:032x}"

    def set_route(self, route: str) -> None:
        """Set ``http.route``: the path with placeholders for names, to keep the number of values low."""
        self._span.set_attribute("http.route", route)
        self._span.update_name(f"{self._method} {route}")

    def set_attributes(self, attributes: Mapping[str, str]) -> None:
        """Set attributes of the request's subject, with the prefix ``linked_fleet.``."""
        self._span.set_attributes({f"linked_fleet.{name}": value for name, value in attributes.items()})

    def start_child_span(self, name: str, is_client: bool, attributes: Mapping[str, str]) -> ChildSpan:
        """Start a child span; ``is_client`` marks a call to another process."""
        from opentelemetry.trace import SpanKind, set_span_in_context

        span = self._tracer.start_span(
            name,
            set_span_in_context(self._span),
            SpanKind.CLIENT if is_client else SpanKind.INTERNAL,
            {f"linked_fleet.{key}": value for key, value in attributes.items()},
        )
        return ChildSpan(span)

    def set_status(self, status: int) -> None:
        from opentelemetry.trace import Status, StatusCode

        self._span.set_attribute("http.response.status_code", status)
        if status >= 500:  # client errors are no server errors
            self._span.set_attribute("error.type", str(status))
            self._span.set_status(Status(StatusCode.ERROR))

    def end(self) -> None:
        self._span.end()


class Tracing:
    """Starts spans of requests; ``close`` exports the remaining ones."""

    def __init__(self, provider: "TracerProvider") -> None:
        self._provider, self._tracer = provider, provider.get_tracer(__name__)

    def start_request_span(self, method: str, scheme: str, path: str, parents: list[str], request_id: str) -> Trace:
        """Start a span; ``parents`` are the ``traceparent`` fields of the request, of which several are all ignored."""
        from opentelemetry.trace import SpanKind

        context = remote_context(traceparent.parse(parents[0]) if len(parents) == 1 else None)
        attributes = {
            "http.request.method": method,
            "url.scheme": scheme,
            "url.path": path,
            "linked_fleet.request": request_id,
        }
        return Trace(self._tracer, self._tracer.start_span(method, context, SpanKind.SERVER, attributes), method)

    def close(self) -> None:
        """Export the remaining spans, for a bounded time. Blocks."""
        close_provider(self._provider)


def open_tracing(environment: Mapping[str, str], instance: str) -> Tracing | None:
    """Return None if no collector is configured. Raises TracingUnavailable."""
    provider = open_provider(environment, {"service.name": "linked-fleet-gateway", "service.instance.id": instance})
    return None if provider is None else Tracing(provider)


NO_SPAN: AbstractContextManager[None] = nullcontext()
