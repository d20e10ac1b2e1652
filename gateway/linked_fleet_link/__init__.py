"""The gateway's side of Zenoh: robots that are present, their state, commands to them.

``transport``: the interface to Zenoh, a protocol class. ``zenoh_session`` implements it and is the only importer of
zenoh; tests use an in-memory network. ``fleet_link``: presence, frames and progress in, commands and queries out.
``incoming``: hand-over from session threads to the event loop. ``discovery``: the runs of robots that are present.
``heartbeat``: the gateway's own.
"""
