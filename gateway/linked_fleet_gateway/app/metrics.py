"""Prometheus metrics of one gateway, collected on request, and periodic measurements for them.

The measurements, event loop lag and age of frames, cost nothing per frame.
"""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from prometheus_client import CollectorRegistry, ProcessCollector
from prometheus_client.metrics_core import CounterMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector

from linked_fleet_gateway.actions.service import Actions
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_gateway.subscriptions.service import Subscriptions
from linked_fleet_runtime.background import cancel_tasks, supervised, time_sliced
from linked_fleet_runtime.metrics import PREFIX, Histogram, RequestMetrics, counter, gauge, gauges, histogram
from linked_fleet_state.fleet import Fleet
from linked_fleet_valkey.server import EmbeddedRedis

log = logging.getLogger(__name__)

_PERIOD_S = 0.25
_ROUND = 4  # periods between two samples of frames


class Sampler:
    """An async context manager. ``loop_lag`` is the lateness of timers of the event loop.

    ``frame_lag`` is the time from the agent's reading of its robot to the arrival at the gateway, sampled once a second
    for the latest frame of each robot; it includes the difference of both clocks.
    """

    def __init__(self, fleet: Fleet) -> None:
        self.loop_lag, self.frame_lag = Histogram(), Histogram()
        self._fleet = fleet
        self._seen: dict[str, tuple[int | None, int | None]] = {}
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        self._tasks = [supervised(self._sample, "sample", log, "delays are not measured", 0.0)]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks(self._tasks)

    async def _sample(self) -> None:
        for _ in range(_ROUND):
            due_s = time.monotonic() + _PERIOD_S
            await asyncio.sleep(_PERIOD_S)
            self.loop_lag.add(time.monotonic() - due_s)
        await self._look_at_frames()

    async def _look_at_frames(self) -> None:
        names = list(self._fleet.robots)
        for name in self._seen.keys() - set(names):
            del self._seen[name]
        async for name in time_sliced(names):
            robot = self._fleet.robots.get(name)
            if robot is None:
                continue  # forgotten meanwhile
            wall_ns, taken_ns = robot.wall_ns, robot.last_seen_ns
            if wall_ns is not None and taken_ns is not None:
                frame = (robot.incarnation, robot.sequence)
                if self._seen.get(robot.name) != frame:
                    self._seen[robot.name] = frame
                    self.frame_lag.add((taken_ns - wall_ns) / 1e9)


def create_registry(numbers: "MetricsCollector") -> CollectorRegistry:
    """Return a registry with the metrics of one gateway and of its process."""
    made = CollectorRegistry()
    made.register(numbers)
    ProcessCollector(registry=made)
    return made


@dataclass(frozen=True, eq=False)
class MetricsCollector(Collector):
    """Reads counters of the event loop from a thread; each single read is atomic."""

    live: Live
    subscriptions: Subscriptions
    actions: Actions
    requests: RequestMetrics
    sampler: Sampler
    embedded: EmbeddedRedis | None
    extensions: Mapping[str, Callable[[], Iterable[Metric]]] = field(default_factory=dict)
    """Functions by the name of their extension."""

    def collect(self) -> Iterator[Metric]:
        """Yield all metrics but those of a part that fails, which is a fault."""
        own = (self._of_robots, self._of_requests, self._of_subscriptions, self._of_commands, self._of_parts)
        for name, collect in {**{each.__name__[1:]: each for each in own}, **self.extensions}.items():
            found = list[Metric]()
            with self.live.faults.guard("metrics", thing=name):
                found = [_checked(each) for each in collect()]
            yield from found
        faults = self.live.faults.counts().items()
        yield gauges("faults", "Things that a part of the gateway cannot describe, and its failures.", "part", faults)

    def _of_parts(self) -> Iterator[Metric]:
        yield histogram("event_loop_lag_seconds", "How late timers of the event loop were.", self.sampler.loop_lag)
        yield gauge("redis_up", "Whether Redis answers.", self.subscriptions.store_is_available)
        set_aside = len(self.embedded.damaged_copies) if self.embedded else 0
        yield gauge("redis_data_set_aside", "Folders of data that the embedded server could not load.", set_aside)
        yield gauge("zenoh_up", "Whether robots can be heard.", self.live.link.is_connected)

    def _of_robots(self) -> Iterator[Metric]:
        fleet, now_ns = self.live.fleet, time.time_ns()
        robots = [robot for name in fleet.robots if (robot := fleet.robots.get(name)) is not None]
        presence = Counter({"online": 0, "offline": 0, "faulty": 0})
        presence.update(robot.presence for robot in robots)
        yield gauges("robots", "Robots by presence.", "presence", presence.items())
        yield gauge(
            "robots_undescribed", "Robots with a presence token and no description.", self.live.link.undescribed_count
        )
        yield gauges(
            "robot_frame_age_seconds", "Time since the latest frame of a robot came.", "robot",
            [
                (robot.name, (now_ns - robot.last_seen_ns) / 1e9)
                for robot in robots
                if robot.sequence is not None and robot.last_seen_ns is not None
            ],
        )  # fmt: skip
        malformed = _sum(fleet.malformed_counts) + _sum(self.live.link.malformed_counts)
        yield counter("frames_taken", "State frames taken.", self.live.accepted_frames)
        yield counter("frames_dropped", "State frames that were late, or of no present run.", _sum(fleet.dropped))
        yield counter("messages_malformed", "Messages of robots, of any kind, refused as ill-formed.", malformed)
        yield histogram(
            "frame_lag_seconds", "From the clock of the agent to that of the gateway; one frame a second and robot.",
            self.sampler.frame_lag,
        )  # fmt: skip

    def _of_requests(self) -> Iterator[Metric]:
        family = CounterMetricFamily(
            PREFIX + "http_requests", "Answers by method and class of status.", labels=("method", "status")
        )
        for (method, status), count in dict(self.requests.responses).items():
            family.add_metric((method, status), count)
        yield family
        latency = HistogramMetricFamily(
            PREFIX + "http_request_seconds", "From a request to the beginning of its answer.", labels=("method",)
        )
        for method, measured in self.requests.latency.copy().items():
            latency.add_metric((method,), measured.buckets(), measured.sum_s)
        yield latency

    def _of_subscriptions(self) -> Iterator[Metric]:
        fan_out, callbacks = self.live.fan_out, self.subscriptions.callbacks
        kinds = {"callback": callbacks.served_count, "websocket": 0, "event-stream": 0, "stream": 0}
        kinds |= self.subscriptions.streams.count_by_kind()
        yield gauges("subscribers", "Subscribers served here, by kind.", "kind", kinds.items())
        yield counter("messages_rendered", "Messages rendered, each for all who take it.", fan_out.messages_rendered)
        yield counter("messages_sent", "Messages handed to a subscriber.", fan_out.messages_sent)
        yield counter(
            "messages_conflated", "Changes that a newer one replaced before they were sent.", fan_out.messages_conflated
        )
        yield counter("deliveries", "Callbacks that receivers took.", callbacks.delivery_metrics.successful)
        yield counter(
            "delivery_failures", "Attempts at which a receiver took nothing.", callbacks.delivery_metrics.failed
        )
        yield gauge(
            "callbacks_suspended", "Callbacks that wait for somebody to resume them.", callbacks.suspended_count
        )

    def _of_commands(self) -> Iterator[Metric]:
        family = CounterMetricFamily(
            PREFIX + "commands", "Commands and stops by what the agent said.", labels=("outcome", "code")
        )
        none = {("accepted", ""): 0, ("silent", ""): 0}  # a rate needs an initial value
        for labels, count in (none | dict(self.actions.lifecycle.command_metrics.outcomes)).items():
            family.add_metric(labels, count)
        yield family
        yield histogram(
            "command_acceptance_seconds", "From a request to the acceptance by the agent.",
            self.actions.lifecycle.command_metrics.acceptance_latency,
        )  # fmt: skip
        yield gauge(
            "robots_owed_a_stop",
            "Robots whose agents have not confirmed a stop.",
            self.actions.lifecycle.stops.robot_count,
        )
        yield gauge("invocations_open", "Invocations known here that have not ended.", self.live.invocations.open_count)


def _sum(counts: Mapping[str, int]) -> int:
    return sum(list(counts.values()))


def _checked(value: object) -> Metric:
    """Return a metric of a part of the gateway. Raises TypeError if it is none."""
    if not isinstance(value, Metric):
        raise TypeError(f"a metric comes from counter, gauge or gauges, and is not {value!r:.80}")
    return value
