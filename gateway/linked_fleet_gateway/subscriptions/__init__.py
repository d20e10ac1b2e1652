"""Subscriptions: watched resources and their subscribers (protocol: PROTOCOL.md beside this file).

``live``: the fleet joined to its link and to those who watch it. ``fan_out``: change → watched resource (``topic``) →
``broadcast`` or ``watcher`` → outlet, in turns of a few milliseconds. ``service``: all subscriptions; ``streams`` are
those open here, ``callbacks`` those served here and taken over, ``courier`` delivers those of one, through the package
linked_fleet_webhooks. ``store``, ``records``, ``redis_scripts``: what is in Redis.
"""
