"""RDF documents: readers of untrusted ones, and writers whose output is stable. It knows no vocabulary of the gateway.

``parsing``, ``json_input``: documents from clients, bounded and offline. ``turtle``, ``jsonld`` and ``jelly`` write
theirs.
"""
