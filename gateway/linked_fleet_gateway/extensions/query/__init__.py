"""Query: SPARQL 1.1 over the live fleet, each query on a consistent snapshot (README.md).

``service`` lets queries take ``turns`` and sends them by ``process`` and ``messages`` to ``worker``, a process that
mirrors the fleet as RDF (``fleet_mirror``, ``rdf_mirror``) and forks for each query (``evaluation``). ``extension``:
the SPARQL protocol. ``description``, ``page``, ``examples``: the endpoint as a resource and as a page. ``functions``:
extension functions.
"""
