"""The Redis keys of subscriptions are plain, and parsed as they were built."""

import re
import uuid

import pytest

from linked_fleet_gateway.actions.redis_scripts import Keys as ActionKeys
from linked_fleet_gateway.subscriptions.redis_scripts import Key, Keys


def test_every_key_is_parsed_as_it_was_built() -> None:
    keys = Keys("site/hall-2")
    id = str(uuid.uuid4())
    for key, parsed in {
        keys.runs: Key("runs"),
        keys.lease("a1"): Key("lease", "a1"),
        keys.held("a1"): Key("held", "a1"),
        keys.record(id): Key("record", id),
        keys.queue(id): Key("queue", id),
        keys.sent(id): Key("sent", id),
        keys.gone(id): Key("gone", id),
        keys.owner("/"): Key("owner", "/"),
        keys.owner("/arm~202/news"): Key("owner", "/arm~202/news"),
        keys.client("2001:db8::1"): Key("client", "2001:db8::1"),
        keys.news: Key("news"),
    }.items():
        assert keys.parse(key) == parsed
    for foreign in ("fleet:news", "site/hall-2", "site/hall-2:", "site/hall-2:subscription:{}", "site/hall-2:news:x"):
        with pytest.raises(ValueError, match="is no key of subscriptions"):
            keys.parse(foreign)


@pytest.mark.parametrize(
    "client",
    ["2001:db8::1", "fe80::1%eth0", "", "192.0.2.1, 10.0.0.1", "{runs}", "}{", "%7Bruns%7D", "7}:queue",
     "x\r\nDEL fleet:news\r\n", "\0\x1b[2J", "später", "*?[a]", "\udcff", "a" * 9000],
)  # fmt: skip
def test_keys_of_clients_are_plain_and_distinct(client: str) -> None:
    keys = Keys("fleet")
    key = keys.client(client)
    assert keys.parse(key) == Key("client", client)
    assert re.fullmatch(r"fleet:client:[A-Za-z0-9%:._~-]*", key)


@pytest.mark.parametrize("keys", [Keys, ActionKeys])
@pytest.mark.parametrize("namespace", ["", "a:b", "{a}", "a b"])
def test_a_namespace_that_would_make_keys_ambiguous_is_refused(keys: type[Keys], namespace: str) -> None:
    with pytest.raises(ValueError, match="is not a plain key"):
        keys(namespace)
