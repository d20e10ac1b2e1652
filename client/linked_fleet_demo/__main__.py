"""``python -m linked_fleet_demo``: runs a gateway and the agents of six simulated robots, until Ctrl-C."""

import signal
import sys


def main() -> int:
    # Ctrl-C during the imports ends the demo silently too.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from linked_fleet_demo.tree import main as run

    return run()


if __name__ == "__main__":
    sys.exit(main())
