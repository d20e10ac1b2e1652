"""``python -m gateway``: settings → socket → application; nothing else."""

import asyncio
import logging
import os
import socket
import sys

import uvicorn

from gateway.app import create_app
from gateway.link import LinkError
from gateway.settings import GatewaySettings


def main() -> int:
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    try:
        settings = GatewaySettings.read(os.environ, sys.argv[1:])
        listener = _listen(settings.host, settings.port_number)
    except (ValueError, OSError) as error:
        print(f"gateway: {error}", file=sys.stderr)
        return 1
    try:
        return asyncio.run(_serve(settings, listener))
    except LinkError as error:
        print(f"gateway: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0
    finally:
        listener.close()


async def _serve(settings: GatewaySettings, listener: socket.socket) -> int:
    app = create_app(settings)
    # The lifespan is entered here, not by the server: its errors stay exceptions, and the address is printed when true.
    config = uvicorn.Config(app, lifespan="off", log_config=None, access_log=False, ws="none", server_header=False)
    async with app.router.lifespan_context(app):
        server = uvicorn.Server(config)
        print(f"serving {settings.public_urls[0]}/", flush=True)
        await server.serve(sockets=[listener])
    return 0


def _listen(host: str, port: int) -> socket.socket:
    """A bound socket; OSError with one clear sentence when the address is taken or not ours."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        raise OSError(f"cannot listen on {host}:{port}: {error.strerror}; choose another with --port") from None
    return listener


if __name__ == "__main__":
    sys.exit(main())
