"""The extension ``pages``: triples as HTML, shapes as forms (Jinja2). ``scripts`` has the sources of its scripts.

``page`` writes; ``view`` reads the triples of a resource, ``fleet_views``, ``vocabulary_view``, ``thing_views`` and
``action_views`` those of a kind; other extensions add a ``views.PageView``, and scripts in a folder ``scripts`` of
their own: pages start its ``page.js`` and include its ``style.css``. ``form``, ``form_parts``: forms from shapes.
``robot_panel``: commands on the page of a robot. ``values``, ``texts``: terms in words. ``assets``, ``thumbnail``:
scripts, styles and drawings as resources. ``extension`` mounts all of it.
"""
