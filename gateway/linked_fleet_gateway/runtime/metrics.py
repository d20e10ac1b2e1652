"""Constructors of Prometheus metric families with the product's prefix."""

from collections.abc import Iterable

from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric

from linked_fleet_gateway.runtime.counters import Histogram

PREFIX = "linked_fleet_"


def counter(name: str, meaning: str, value: int) -> Metric:
    return CounterMetricFamily(PREFIX + name, meaning, value)


def gauge(name: str, meaning: str, value: float) -> Metric:
    return GaugeMetricFamily(PREFIX + name, meaning, value)


def gauges(name: str, meaning: str, label: str, values: Iterable[tuple[str, float]]) -> Metric:
    gauge = GaugeMetricFamily(PREFIX + name, meaning, labels=(label,))
    for key, value in values:
        gauge.add_metric((key,), value)
    return gauge


def histogram(name: str, meaning: str, histogram: Histogram) -> Metric:
    return HistogramMetricFamily(PREFIX + name, meaning, histogram.buckets(), histogram.sum_s)
