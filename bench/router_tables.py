"""Declarations that a Zenoh router knows, counted by its admin space: ``python -m bench.router_tables ENDPOINT``.

Prints one line of JSON: how many tokens, queryables and subscribers the router knows in all (``all``), and by the
address of each neighbour how many of them that neighbour has declared.
"""

import json
import sys
import threading
from collections import Counter
from typing import Any

import zenoh

KINDS = ("token", "queryable", "subscriber")
_TIMEOUT_S = 180.0


def main(endpoint: str) -> None:
    config = zenoh.Config()
    for name, value in {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
    }.items():
        config.insert_json5(name, json.dumps(value))
    with zenoh.open(config) as session:
        (router,) = session.info.routers_zid()
        root = f"@/{router}/router"
        ((_, state),) = _answers(session, root)
        neighbours = {
            each["peer"]: each["links"][0]["dst"].partition("/")[2].rpartition(":")[0]
            for each in state["sessions"]
            if each["links"]
        }
        found: dict[str, Counter[str]] = {"all": Counter(), **{address: Counter() for address in neighbours.values()}}
        for kind in KINDS:
            for key, said in _answers(session, f"{root}/{kind}/**"):
                if "/@/" in key.removeprefix(root):  # of the admin space itself
                    continue
                found["all"][kind] += 1
                for peer in {*said["routers"], *said["peers"], *said["clients"]} & neighbours.keys():
                    found[neighbours[peer]][kind] += 1
    print(json.dumps(found))


def _answers(session: zenoh.Session, key: str) -> list[tuple[str, Any]]:
    replies, over = list[zenoh.Reply](), threading.Event()
    handler: Any = zenoh.handlers.Callback(replies.append, drop=over.set, indirect=False)
    session.get(key, handler, timeout=_TIMEOUT_S)
    assert over.wait(_TIMEOUT_S), f"the router does not list {key}"
    return [(str(each.ok.key_expr), json.loads(each.ok.payload.to_bytes())) for each in replies if each.ok is not None]


if __name__ == "__main__":
    main(sys.argv[1])
