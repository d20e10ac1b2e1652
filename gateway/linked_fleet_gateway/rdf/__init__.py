"""RDF: terms, graphs, parsers and writers. Pure; knows no robot.

``vocabulary``: every IRI, spelt once (``vocabulary.ttl`` describes our own). ``graph``: building blocks of a
description, units and their IRIs. ``parsing``, ``json_input``: documents from clients, bounded and offline.
``serialise``: every media type; ``turtle``, ``jsonld``, ``jelly`` write theirs; ``templates`` fills in what was written
for another description of the same form. ``shapes``: the Turtle of ``shapes/`` and of extensions. ``validation``:
validates request bodies with a published shape, and finds statements that a write would lose. ``sparql_tokens``:
the tokens of SPARQL.
"""
