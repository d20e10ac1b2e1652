"""The extension ``pages``: triples as HTML, shapes as forms (Jinja2). ``scripts`` has the sources of its scripts.

``page`` writes; ``view`` reads the triples of a resource, ``thing_views`` and ``action_views`` those of a kind; other
extensions add a ``views.PageView``. ``form``: forms from shapes. ``values``, ``labels``: terms in words.
"""
