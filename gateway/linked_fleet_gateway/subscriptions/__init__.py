"""Subscriptions: watched resources and their subscribers (protocol: PROTOCOL.md beside this file).

``live`` connects the fleet, its link and its subscribers. ``fan_out`` carries changes: changed resource (``topic``) →
``broadcast`` or ``watcher`` → outlet, in turns of a few milliseconds. ``service`` manages all subscriptions,
``streams`` the streams of this gateway, ``callbacks`` its callbacks (created here or taken over). ``courier`` delivers
one callback, ``receiver`` makes its HTTP requests, and ``network`` decides which addresses it may reach. ``store``,
``runs``, ``records``, ``redis_keys`` and ``redis_scripts`` hold the state in Redis.
"""
