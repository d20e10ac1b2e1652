"""Counters, and families of Prometheus metrics named after the product."""

import logging
import time
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import accumulate

from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric

from linked_fleet_agent.wire.messages import Accepted, Refused, Reply
from linked_fleet_runtime.log import current_request

log = logging.getLogger(__name__)

LATENCY_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0)
_CLASSES = tuple(f"{first}xx" for first in range(10))
_METHODS = frozenset(("GET", "HEAD", "OPTIONS", "POST", "PUT", "PATCH", "DELETE"))


class Histogram:
    """Counts of durations by upper bound, in seconds."""

    def __init__(self, bounds_s: tuple[float, ...] = LATENCY_S) -> None:
        self._bounds_s = bounds_s
        self._counts = [0] * (len(bounds_s) + 1)
        self.sum_s = 0.0

    def add(self, duration_s: float) -> None:
        """Add a duration. Negative values, possible with two clocks, count as zero."""
        self._counts[bisect_left(self._bounds_s, duration_s)] += 1
        self.sum_s += max(0.0, duration_s)

    def buckets(self) -> list[tuple[str, float]]:
        """Return Prometheus buckets: each upper bound with its cumulative count."""
        return list(zip([*map(str, self._bounds_s), "+Inf"], accumulate(self._counts), strict=True))


@dataclass
class RequestMetrics:
    """Requests by method and status class, and the time to the start of the response by method (streams never end)."""

    responses: Counter[tuple[str, str]] = field(default_factory=Counter)
    latency: dict[str, Histogram] = field(default_factory=dict)

    def add(self, method: str, status: int, duration_s: float) -> None:
        if method not in _METHODS:
            method = "other"
        self.responses[method, _CLASSES[status // 100]] += 1
        latency = self.latency.get(method)
        if latency is None:
            latency = self.latency[method] = Histogram()
        latency.add(duration_s)


@dataclass
class CommandMetrics:
    """Replies of agents to commands and stops, by outcome and refusal code."""

    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)
    acceptance_latency: Histogram = field(default_factory=Histogram)

    def count_reply(self, robot: str, reply: Reply | None) -> None:
        """Count a reply; None means no reply. Acceptances are timed from the start of the current request."""
        outcome, code = ("silent", "") if reply is None else ("accepted", "")
        if isinstance(reply, Refused):
            outcome, code = "refused", reply.code
        self.outcomes[outcome, code] += 1
        if isinstance(reply, Accepted) and (asked := current_request()) is not None:
            self.acceptance_latency.add(time.monotonic() - asked.started_s)
        level = logging.DEBUG if outcome == "accepted" else logging.INFO
        if log.isEnabledFor(level):
            said = f"{outcome} ({code})" if code else outcome
            log.log(level, "robot %s: command %s", robot, said, extra={"robot": robot})


@dataclass
class DeliveryMetrics:
    """Deliveries to callbacks: successful ones, and failed attempts."""

    successful: int = 0
    failed: int = 0


PREFIX = "linked_fleet_"


def counter(name: str, meaning: str, value: int) -> Metric:
    """Return a metric that only grows; its name gets the prefix ``linked_fleet_``."""
    return CounterMetricFamily(PREFIX + name, meaning, value)


def gauge(name: str, meaning: str, value: float) -> Metric:
    """Return a metric with one value; its name gets the prefix ``linked_fleet_``."""
    return GaugeMetricFamily(PREFIX + name, meaning, value)


def gauges(name: str, meaning: str, label: str, values: Iterable[tuple[str, float]]) -> Metric:
    """Return a metric with a value for each value of a label; its name gets the prefix ``linked_fleet_``."""
    gauge = GaugeMetricFamily(PREFIX + name, meaning, labels=(label,))
    for key, value in values:
        gauge.add_metric((key,), value)
    return gauge


def histogram(name: str, meaning: str, histogram: Histogram) -> Metric:
    return HistogramMetricFamily(PREFIX + name, meaning, histogram.buckets(), histogram.sum_s)
