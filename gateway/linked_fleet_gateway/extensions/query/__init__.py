"""Query: SPARQL 1.1 over the live fleet, each query on a consistent snapshot (README.md).

``service`` sends queries to ``worker``, a process that mirrors the fleet as RDF (``fleet_mirror``, ``rdf_mirror``) and
forks for each query (``evaluation``). ``http``: the SPARQL protocol. ``functions``: extension functions.
"""
