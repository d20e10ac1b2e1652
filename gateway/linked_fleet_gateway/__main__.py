"""Command line of the gateway, ``python -m linked_fleet_gateway``."""

import sys

from linked_fleet_gateway.app.main import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
