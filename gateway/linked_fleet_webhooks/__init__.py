"""Webhooks: HTTP requests to receivers that anybody may name, and that may be hostile. It knows no subscription.

``network``: addresses that a request may reach. ``receiver``: requests to one receiver, on connections to judged
addresses. ``delivery_pace``: pauses between attempts, and between requests for consent. ``signature``: signed messages.
"""
