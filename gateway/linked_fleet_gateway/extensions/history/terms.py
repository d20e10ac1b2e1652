"""Terms of the extension, beside those of the core; vocabulary.ttl and shapes.ttl describe them."""

from linked_fleet_gateway.rdf.vocabulary import LF as CORE

LF = CORE.extended(
    "History HistoryList HistoryListShape HistoryShape histories history historySpan samplingPeriod oldestSample "
    "newestSample sampleCount from to last limit"
)
