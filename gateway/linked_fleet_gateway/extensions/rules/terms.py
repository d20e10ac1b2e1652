"""Terms of the extension, beside those of the core; vocabulary.ttl and shapes.ttl describe them."""

from linked_fleet_gateway.rdf.vocabulary import LF as CORE

LF = CORE.extended(
    "Rule Firing RuleList FiringList RuleShape RuleResourceShape FiringShape disabled suppressed rules"
    " condition invokes body toldApartBy enabled firings lastFiring causedBy suppressions variable"
    " binding invocation"
)
