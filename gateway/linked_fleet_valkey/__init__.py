"""Valkey: the server that a gateway starts if no Redis is configured. It imports nothing of the gateway.

``server``: the child process, shared by the gateways of one state folder. ``damaged_data`` keeps data that it cannot
load.
"""
