"""Query: SPARQL 1.1 over the live fleet, each query of one instant (README.md).

``service`` asks ``worker``, a process that mirrors the fleet as RDF (``fleet_mirror``, ``rdf_mirror``) and gives each
query a copy of itself (``evaluation``). ``http``: the protocol. ``functions``: functions beside SPARQL's own.
"""
