"""Every Redis key of the rules, built here and nowhere else; all in one slot, so that one script can touch them."""

from dataclasses import dataclass

from linked_fleet_gateway.actions.redis_keys import hashed


@dataclass(frozen=True)
class Keys:
    namespace: str = "fleet"

    @property
    def records(self) -> str:
        """Hash of the rules by id."""
        return self._key("records")

    @property
    def revisions(self) -> str:
        """Hash of how often each was written, by id."""
        return self._key("revisions")

    @property
    def server(self) -> str:
        """The run of the gateway that evaluates rules; it expires with its lease."""
        return self._key("server")

    @property
    def seen(self) -> str:
        """Set of the robots that were there when rules were evaluated last."""
        return self._key("seen")

    @property
    def news(self) -> str:
        """Stream of what gateways tell each other."""
        return self._key("news")

    def of_client(self, client: str) -> str:
        """Set of the ids of its rules."""
        return self._key(f"client:{hashed(client)}")

    def of_rule(self, id: str) -> tuple[str, str, str]:
        """Set of the keys of the rows that hold, hash of counts, hash of firings by number."""
        return self._key(f"{id}:holds"), self._key(f"{id}:counts"), self._key(f"{id}:firings")

    def _key(self, part: str) -> str:
        return f"{self.namespace}:{{rules}}:{part}"
