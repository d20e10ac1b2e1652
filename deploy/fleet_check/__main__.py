"""Starts the compose fleet, checks it from outside and takes it down: make fleet-check

Prints one line for each check; exit code 0 if all of them passed.
"""

import argparse
import contextlib
import http.client
import signal
import socket
import sys
import time

from backup_check import backup
from checks import CHECKS, Fleet, wait_for
from front import Front
from stack import Stack, StackError, compose_command
from websockets.exceptions import WebSocketException

ALL = (*CHECKS, backup)
DOMAIN = "fleet.localhost"
_AUTHORITY = "/data/caddy/pki/authorities/local/root.crt"
# Addresses of containers in docker and podman.
_PRIVATE = "10.0.0.0/8,172.16.0.0/12,192.168.0.0/16"
_FAILURES = (AssertionError, StackError, OSError, http.client.HTTPException, WebSocketException)


def main() -> int:
    parser = argparse.ArgumentParser(prog="make fleet-check", description="Check the compose fleet from outside.")
    parser.add_argument("--compose", default="", help="the compose command (default: docker compose, podman-compose)")
    parser.add_argument("--keep", action="store_true", help="leave the fleet running")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that the stack is taken down
    port, receiver_port = _free_port(), _free_port()
    try:
        stack = Stack(
            compose_command(arguments.compose),
            {
                "LINKED_FLEET_DOMAIN": DOMAIN,
                "LINKED_FLEET_HTTPS_PORT": str(port),
                "LINKED_FLEET_ROUTER_PORT": str(_free_port()),
                "LINKED_FLEET_CALLBACK_ALLOW": _PRIVATE,
                "FLEET_CHECK_RECEIVER_PORT": str(receiver_port),
            },
        )
        stack.build()
    except StackError as error:
        print(f"fleet-check: {error}", file=sys.stderr)
        return 2
    try:
        stack.up()
        authority = wait_for(lambda: _authority(stack), "the front's certificate authority")
        return _check(Fleet(stack, Front(DOMAIN, port, authority), receiver_port))
    except _FAILURES as error:
        print(f"FAILED  the fleet starts: {error}", flush=True)
        return 1
    finally:
        if not arguments.keep:
            stack.down()


def _check(fleet: Fleet) -> int:
    """Run the checks in order; only the first, if it fails, prevents the others."""
    held = 0
    for check in ALL:
        begun = time.monotonic()
        try:
            check(fleet)
            held += 1
            print(f"held    {check.__doc__} ({time.monotonic() - begun:.1f} s)", flush=True)
        except _FAILURES as error:
            print(f"FAILED  {check.__doc__}: {error}", flush=True)
            if check is ALL[0]:
                break
    print(f"{held} of {len(ALL)} held.", flush=True)
    if held < len(ALL):
        for service in ("router", "redis", "gateway", "front"):
            with contextlib.suppress(StackError):
                print(f"--- {service}\n{fleet.stack.logs(service)}", file=sys.stderr)
    return 0 if held == len(ALL) else 1


def _authority(stack: Stack) -> str:
    with contextlib.suppress(StackError, IndexError):
        return stack.read("front", _AUTHORITY)
    return ""


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    sys.exit(main())
