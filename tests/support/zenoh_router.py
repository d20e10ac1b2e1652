"""A Zenoh router as a process, like ``zenohd``. Arguments: LISTEN or a file, and endpoints of other routers.

With a file they replace its own (``zenohd -c FILE -e ENDPOINT``).
"""

import json
import signal
import sys

import zenoh


def main(listen: str, *others: str) -> None:
    zenoh.init_log_from_env_or("error")
    config = _from_file(listen, *others) if listen.endswith(".json5") else _configuration(listen, *others)
    with zenoh.open(config):
        print("routing", flush=True)
        signal.sigwait({signal.SIGTERM, signal.SIGINT})


def _from_file(path: str, *others: str) -> zenoh.Config:
    config = zenoh.Config.from_file(path)
    if others:
        config.insert_json5("connect/endpoints", json.dumps(others))
    return config


def _configuration(listen: str, *others: str) -> zenoh.Config:
    config = zenoh.Config()
    for name, value in {
        "mode": "router",
        "listen/endpoints": [listen],
        "connect/endpoints": list(others),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
    }.items():
        config.insert_json5(name, json.dumps(value))
    return config


if __name__ == "__main__":
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})
    main(*sys.argv[1:])
