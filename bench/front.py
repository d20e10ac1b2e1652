"""Caddy in front of a gateway: HTTP/1.1, 2 and 3 with its own certificate authority, as in deploy/caddy."""

import contextlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bench.far import NAME
from bench.table import UnavailableError
from running import eventually

_CONFIGURATION = """{{
	admin off
	skip_install_trust
	auto_https disable_redirects
}}
https://{name}:{port} {{
	bind {address}
	tls internal
	reverse_proxy 127.0.0.1:{gateway} {{
		header_up Host {{upstream_hostport}}
		flush_interval -1
		transport http {{
			versions 1.1
		}}
	}}
}}
"""


@dataclass(frozen=True)
class Front:
    address: str
    port: int
    authority: Path


def program() -> str:
    """Return the program: $CADDY, or from the path."""
    found = shutil.which(os.environ.get("CADDY", "caddy"))
    if found is None:
        raise UnavailableError(
            "Caddy is not here, the front that speaks HTTP/2 and 3: apt install caddy, or name it in CADDY"
        )
    return found


@contextlib.contextmanager
def front(address: str, port: int, gateway: int) -> Iterator[Front]:
    """Run Caddy at ``address`` and ``port`` for the gateway at loopback port ``gateway``."""
    caddy = program()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "Caddyfile")
        path.write_text(_CONFIGURATION.format(name=NAME, address=address, port=port, gateway=gateway))
        environment = {**os.environ, "XDG_DATA_HOME": folder, "XDG_CONFIG_HOME": folder}
        with Path(folder, "log").open("w+") as log:
            child = subprocess.Popen((caddy, "run", "--config", str(path)), env=environment, stderr=log)  # noqa: S603
            try:
                served = Path(folder, "caddy", "certificates", "local", NAME, f"{NAME}.crt")
                eventually(lambda: served.exists() or child.poll() is not None, "a certificate of Caddy")
                assert child.poll() is None, Path(folder, "log").read_text()
                yield Front(address, port, Path(folder, "caddy", "pki", "authorities", "local", "root.crt"))
            finally:
                child.terminate()
                child.wait()
