"""The numbers of one gateway as Prometheus reads them, collected when it asks."""

import asyncio
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from prometheus_client import CollectorRegistry, ProcessCollector
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.requests import Request
from starlette.responses import Response

from gateway.actions.service import Actions
from gateway.app.sampler import Sampler
from gateway.extensions.history.recorder import History
from gateway.extensions.rules.description import rule_state
from gateway.extensions.rules.service import Rules
from gateway.runtime.counters import Histogram, Requests
from gateway.runtime.embedded_redis import Embedded
from gateway.subscriptions.live import Live
from gateway.subscriptions.service import Subscriptions

_PREFIX = "linked_fleet_"


async def metrics(request: Request) -> Response:
    """All numbers as text. It is put together in a thread: of ten thousand robots it is a megabyte."""
    text = await asyncio.to_thread(generate_latest, request.app.state.registry)
    return Response(text, headers={"content-type": CONTENT_TYPE_PLAIN_0_0_4})


def registry(numbers: "Numbers") -> CollectorRegistry:
    """A registry with the numbers of one gateway, and with memory, time and files of its process."""
    made = CollectorRegistry()
    made.register(numbers)
    ProcessCollector(registry=made)
    return made


@dataclass(frozen=True, eq=False)
class Numbers(Collector):
    """Reads, in a thread beside the event loop, what is counted in it: each number and each copy is taken at once."""

    live: Live
    subscriptions: Subscriptions
    actions: Actions
    requests: Requests
    sampler: Sampler
    history: History
    rules: Rules
    embedded: Embedded | None

    def collect(self) -> Iterator[Metric]:
        yield from self._of_robots()
        yield from self._of_requests()
        yield from self._of_subscriptions()
        yield from self._of_commands()
        yield from self._of_rules()
        yield _histogram("event_loop_lag_seconds", "How late timers of the event loop were.", self.sampler.loop_lag)
        yield _gauge("history_bytes", "Memory of the histories of all robots.", self.history.bytes)
        yield _gauge("history_samples", "Samples in the histories of all robots.", self.history.samples)
        yield _gauge("redis_up", "Whether Redis answers.", self.subscriptions.store_answers)
        set_aside = len(self.embedded.set_aside) if self.embedded else 0
        yield _gauge("redis_data_set_aside", "Folders of data that the embedded server could not load.", set_aside)
        yield _gauge("zenoh_up", "Whether robots can be heard.", self.live.link.joined)

    def _of_robots(self) -> Iterator[Metric]:
        fleet, now_ns = self.live.fleet, time.time_ns()
        robots = [robot for name in fleet.robots if (robot := fleet.robots.get(name)) is not None]
        presence = Counter({"online": 0, "offline": 0, "faulty": 0})
        presence.update(robot.presence for robot in robots)
        yield _gauges("robots", "Robots by presence.", "presence", presence.items())
        yield _gauge(
            "robots_undescribed", "Robots with a presence token and no description.", self.live.link.undescribed
        )
        yield _gauges(
            "robot_frame_age_seconds", "Time since the latest frame of a robot came.", "robot",
            [
                (robot.name, (now_ns - robot.last_seen_ns) / 1e9)
                for robot in robots
                if robot.header is not None and robot.last_seen_ns is not None
            ],
        )  # fmt: skip
        malformed = _sum(fleet.malformed) + _sum(self.live.link.malformed)
        yield _counter("frames_taken", "State frames taken.", self.live.frames)
        yield _counter("frames_dropped", "State frames that were late, or of no present run.", _sum(fleet.dropped))
        yield _counter("messages_malformed", "Messages of robots, of any kind, refused as ill-formed.", malformed)
        yield _histogram(
            "frame_lag_seconds", "From the clock of the agent to that of the gateway; one frame a second and robot.",
            self.sampler.frame_lag,
        )  # fmt: skip

    def _of_requests(self) -> Iterator[Metric]:
        counter = CounterMetricFamily(
            _PREFIX + "http_requests", "Answers by method and class of status.", labels=("method", "status")
        )
        for (method, status), count in dict(self.requests.answered).items():
            counter.add_metric((method, status), count)
        yield counter
        latency = HistogramMetricFamily(
            _PREFIX + "http_request_seconds", "From a request to the beginning of its answer.", labels=("method",)
        )
        for method, histogram in self.requests.latency.copy().items():
            latency.add_metric((method,), histogram.buckets(), histogram.sum_s)
        yield latency

    def _of_subscriptions(self) -> Iterator[Metric]:
        fan_out, callbacks = self.live.fan_out, self.subscriptions.callbacks
        kinds = {"callback": callbacks.served, "websocket": 0, "event-stream": 0, "stream": 0}
        kinds |= self.subscriptions.streams.kinds()
        yield _gauges("subscribers", "Subscribers served here, by kind.", "kind", kinds.items())
        yield _counter("messages_rendered", "Messages rendered, each for all who take it.", fan_out.renders)
        yield _counter("messages_sent", "Messages handed to a subscriber.", fan_out.messages)
        yield _counter(
            "messages_conflated", "Changes that a newer one replaced before they were sent.", fan_out.conflated
        )
        yield _counter("deliveries", "Callbacks that receivers took.", callbacks.deliveries.taken)
        yield _counter("delivery_failures", "Attempts at which a receiver took nothing.", callbacks.deliveries.failed)
        yield _gauge("callbacks_suspended", "Callbacks that wait for somebody to resume them.", callbacks.suspended)

    def _of_rules(self) -> Iterator[Metric]:
        states = Counter(rule_state(known).value.rpartition("#")[2] for known in list(self.rules.known.values()))
        yield _gauges("rules", "Rules by state.", "state", states.items())
        yield _counter("rule_loops", "Rules disabled here because they fired because of themselves.", self.rules.loops)

    def _of_commands(self) -> Iterator[Metric]:
        counter = CounterMetricFamily(
            _PREFIX + "commands", "Commands and stops by what the agent said.", labels=("outcome", "code")
        )
        none = {("accepted", ""): 0, ("silent", ""): 0}  # a rate needs a number to begin with
        for labels, count in (none | dict(self.actions.commands.outcomes)).items():
            counter.add_metric(labels, count)
        yield counter
        yield _histogram(
            "command_acceptance_seconds", "From a request to the acceptance by the agent.",
            self.actions.commands.acceptance,
        )  # fmt: skip
        yield _gauge("invocations_open", "Invocations known here that have not ended.", self.live.invocations.open)


def _sum(counts: Mapping[str, int]) -> int:
    return sum(list(counts.values()))


def _counter(name: str, meaning: str, value: int) -> Metric:
    return CounterMetricFamily(_PREFIX + name, meaning, value)


def _gauge(name: str, meaning: str, value: float) -> Metric:
    return GaugeMetricFamily(_PREFIX + name, meaning, value)


def _gauges(name: str, meaning: str, label: str, values: Iterable[tuple[str, float]]) -> Metric:
    gauge = GaugeMetricFamily(_PREFIX + name, meaning, labels=(label,))
    for key, value in values:
        gauge.add_metric((key,), value)
    return gauge


def _histogram(name: str, meaning: str, histogram: Histogram) -> Metric:
    return HistogramMetricFamily(_PREFIX + name, meaning, histogram.buckets(), histogram.sum_s)
