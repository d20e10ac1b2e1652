"""Opening of invocations: lease, idempotency key, limit of the client and record in Redis, in one step."""

from dataclasses import replace

from linked_fleet_base.errors import Conflict, RedisUnavailable
from linked_fleet_gateway.actions.lifecycle import Lifecycle
from linked_fleet_gateway.actions.plan import Caller
from linked_fleet_gateway.actions.refusals import MotionQuota, raise_first_refusal, translate_store_errors
from linked_fleet_gateway.actions.stop_delivery import ANSWER_TIMEOUT_S
from linked_fleet_gateway.actions.store import ActionStore, MotionLimitReached
from linked_fleet_state.invocations import Invocation, InvocationState
from linked_fleet_state.robot import Robot


class Opening:
    """Opens invocations of one gateway, and finds those that a request repeats."""

    def __init__(self, store: ActionStore, lifecycle: Lifecycle, quota: MotionQuota) -> None:
        self._store, self._lifecycle, self._quota = store, lifecycle, quota

    async def create(self, invocation: Invocation, caller: Caller) -> tuple[Invocation, bool]:
        """Store and register a new invocation, and return it with True; with False and the first id if it repeats one.

        Raises Controlled, Conflict for a lease that is not held, KeyReused, TooManyInvocations, RedisUnavailable.
        """
        with self._quota.count_start(caller.name) as full:
            with translate_store_errors():
                try:
                    first = await self._create(invocation, caller, full)
                except RedisUnavailable:  # perhaps after it was executed
                    first = await self._create(invocation, caller, full)
                if first is not None:
                    return replace(invocation, id=first), False
            return self._lifecycle.register(invocation), True

    async def _create(self, invocation: Invocation, caller: Caller, full: bool) -> str | None:
        try:
            return await self._store.create(
                invocation,
                lease_token=caller.lease_token,
                idempotency_key=caller.idempotency_key,
                request_digest=caller.request_digest,
                limit_reached=full,
            )
        except MotionLimitReached as error:
            raise self._quota.limit_error(caller.name) from error

    async def first(self, robot: Robot | None, repeated: Invocation) -> Invocation:
        """Return the invocation of an earlier request with the same key, once it was answered."""
        invocation = await self._lifecycle.replicated_state.fetch(repeated.robot, repeated.id)
        if invocation is None:
            raise Conflict("The first request with this Idempotency-Key has been answered, and its invocation deleted.")
        await self._lifecycle.waiters.wait_until(invocation, _is_answered, ANSWER_TIMEOUT_S)
        raise_first_refusal(robot, invocation)
        return invocation

    async def check(self, robot: str, caller: Caller, lease: str = "") -> None:
        """Check if ``create`` would admit an invocation now. Raises Controlled, Conflict, TooManyInvocations,
        RedisUnavailable.
        """
        if self._quota.is_exhausted(caller.name):
            raise self._quota.limit_error(caller.name)
        with translate_store_errors():
            await self._store.check_lease(robot, caller.lease_token, lease)


def _is_answered(invocation: Invocation) -> bool:
    """Return True if the agent has answered, or has not in time."""
    return invocation.accepted or invocation.state is not InvocationState.ACCEPTED
