"""Terms of components (vocabulary.ttl)."""

from linked_fleet_rdf.vocabulary import LF as CORE

LF = CORE.extended(
    "Component ComponentShape ComponentAction ComponentProperty ComponentEvent publishedAt unknownAfter moves"
    " stopTime occurrences feedback streamProtocol ageLimit silenceLimit endsAfter samples applied late reordered"
    " future invalid Mode stopped"
)
