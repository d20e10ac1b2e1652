"""Link: the gateway's end of Zenoh.

``transport``: the seam, a protocol class; ``zenoh_session`` alone imports zenoh and implements it, tests have a network
in memory. ``fleet_link``: presence, frames and progress in, commands and questions out. ``incoming``: from the threads
of the session into the event loop. ``discovery``: which runs of which robots are there. ``heartbeat``: the gateway's
own. ``questions``, ``meshes``: questions to agents, and the meshes that they hand out.
"""
