"""RDF: documents, terms, graphs and shapes. Pure; knows no robot.

Of documents, usable alone: ``parsing`` and ``json_input`` read those of clients, bounded and offline; ``turtle``,
``jsonld`` and ``jelly`` write stable ones.

For the gateway: ``vocabulary``: every IRI, spelt once (``vocabulary.ttl`` describes our own). ``graph``: building
blocks of a description, units and their IRIs. ``serialise``: every media type; ``templates`` fills in what was written
for another description of the same form. ``shapes``: the Turtle of ``shapes/`` and of extensions. ``validation``:
validates request bodies with a published shape, and finds statements that a write would lose. ``sparql_tokens``: the
tokens of SPARQL.
"""
