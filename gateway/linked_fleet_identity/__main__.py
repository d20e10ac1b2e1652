"""Command line that creates a token: ``python -m linked_fleet_identity NAME --scope read --robot 'lab-*'``.

It prints the token once, with the lines to add to the file of identities.
"""

import argparse
import json
import secrets
import sys
from collections.abc import Sequence
from hashlib import sha256

from linked_fleet_identity.rights import EVERY, Right

_TOKEN_BYTES = 32  # with 256 bits a plain hash is as safe as a slow one


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m linked_fleet_identity", description="Make a token (docs/IDENTITIES.md)"
    )
    parser.add_argument("name", help="who will have it")
    parser.add_argument("--scope", action="append", required=True, choices=list(Right), help="once for each right")
    parser.add_argument("--robot", action="append", help="pattern of the robots' names, such as 'lab-*' (default: all)")
    parser.add_argument("--expires", help="such as 2030-01-01T00:00:00Z (default: never)")
    asked = parser.parse_args(arguments)
    token, toml = new_token(asked.name, asked.scope, asked.robot or [EVERY], asked.expires or "")
    print(f"The token, which nobody can show again: {token}", file=sys.stderr)
    print(toml)
    return 0


def new_token(name: str, scopes: Sequence[str], robots: Sequence[str], expires: str = "") -> tuple[str, str]:
    """Return a token and its table for the file of identities."""
    token = "lf_" + secrets.token_urlsafe(_TOKEN_BYTES)
    lines = [
        "[[token]]",
        f"name = {json.dumps(name)}",
        f'sha256 = "{sha256(token.encode()).hexdigest()}"',
        f"scopes = {json.dumps(list(scopes))}",
        f"robots = {json.dumps(list(robots))}",
        *([f"expires = {expires}"] if expires else []),
    ]
    return token, "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
