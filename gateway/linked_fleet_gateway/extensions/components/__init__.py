"""Components of robots: what a robot declares about its parts, as RDF and SHACL.

``places``: the term that links each declared value to its owner. ``values``: JSON values as triples and back.
``shapes``: schemas as SHACL shapes, which describe and guard. ``vocabulary``: the terms of a robot's own. All of a
robot together is in ``declarations``. Every module is pure.
"""
