"""The caller of an action, and what a request says besides its body."""

from dataclasses import dataclass

from linked_fleet_gateway.identity.rights import ALL, View


@dataclass(frozen=True)
class Caller:
    """``name``: as it is shown; ``token``: of the control lease; ``key``: an idempotency key, for the request that
    ``digest`` stands for; ``body``: what was admitted, as N-Triples; ``stops``: robots that it may stop;
    ``sees``: those that it may be told of; ``rule``: the rule that asks in the name of its creator, empty for others.
    """

    name: str = ""
    token: str = ""
    key: str = ""
    digest: str = ""
    body: str = ""
    stops: View = ALL
    sees: View = ALL
    rule: str = ""
