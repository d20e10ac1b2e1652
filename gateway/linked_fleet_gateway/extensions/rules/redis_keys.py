"""All Redis keys of rules, built only here. They share one slot, so that one script can access them."""

from dataclasses import dataclass

from linked_fleet_gateway.actions.redis_scripts import hashed


@dataclass(frozen=True)
class Keys:
    namespace: str = "fleet"

    @property
    def records(self) -> str:
        """Hash of rules by id."""
        return self._key("records")

    @property
    def revisions(self) -> str:
        """Hash of revision numbers by id."""
        return self._key("revisions")

    @property
    def server(self) -> str:
        """The run of the gateway that evaluates rules; expires with its lease."""
        return self._key("server")

    @property
    def seen(self) -> str:
        """Set of the robots that were online at the last evaluation."""
        return self._key("seen")

    @property
    def news(self) -> str:
        """Stream of changes, for other gateways."""
        return self._key("news")

    def of_client(self, client: str) -> str:
        """Set of the ids of the client's rules."""
        return self._key(f"client:{hashed(client)}")

    def of_rule(self, id: str) -> tuple[str, str, str]:
        """Set of the keys of rows that hold, hash of counts, hash of firings by number."""
        return self._key(f"{id}:holds"), self._key(f"{id}:counts"), self._key(f"{id}:firings")

    def _key(self, part: str) -> str:
        return f"{self.namespace}:{{rules}}:{part}"
