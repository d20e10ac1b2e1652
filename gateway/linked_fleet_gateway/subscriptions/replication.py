"""Confirmation by replicas that they have an accepted callback.

A callback is confirmed if the master of its record has a replica in step; its lists are then confirmed too where their
masters have replicas. Nothing else waits for replicas: a failover can lose the last moment of deliveries.
"""

from linked_fleet_gateway.resources.subscription import Subscription
from linked_fleet_gateway.runtime.redis import Connection, StoreUnavailable
from linked_fleet_gateway.subscriptions import redis_scripts as scripts
from linked_fleet_gateway.subscriptions.redis_scripts import Keys


async def confirm(redis: Connection, keys: Keys, run: str, subscription: Subscription) -> None:
    """Wait until a replica confirms a callback that ``run`` holds, and one of each other master its lists.

    Raises StoreUnavailable if none confirms in time, or if the callback is gone.
    """
    id = subscription.id
    lists = (keys.held(run), keys.owner(subscription.owner), keys.client(subscription.client))
    others = await redis.elsewhere(keys.record(id), lists)
    online = await redis.all([("EVAL", scripts.REPLICAS, 1, key) for key in others])
    replicated = [key for key, is_so in zip(others, online, strict=True) if is_so]
    for key, member in [(keys.record(id), "holder"), *((key, id) for key in replicated)]:
        found, confirmed = await redis.replicated(scripts.REPEAT, key, member)
        if not found:  # a failover lost it, or it has been removed already
            raise StoreUnavailable(f"subscription {id} was gone before a replica had it")
        if not confirmed:
            raise StoreUnavailable(f"no replica of Redis confirmed subscription {id} in time")
