"""Health check of a gateway's container: exit code 0 while its /health/ready answers 200."""

import http.client
import os
import ssl
import sys


def main() -> int:
    port = int(os.environ.get("LINKED_FLEET_PORT", "8000"))
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=4)
    if os.environ.get("LINKED_FLEET_TLS_CERT"):
        # The request goes to this container itself, whose certificate has its public name.
        connection = http.client.HTTPSConnection("127.0.0.1", port, timeout=4, context=_unverified())
    try:
        connection.request("GET", "/health/ready")
        answer = connection.getresponse()
        print(answer.status, answer.read(1000).decode(errors="replace"))
    except (OSError, http.client.HTTPException) as error:
        print(error)
        return 1
    return 0 if answer.status == http.client.OK else 1


def _unverified() -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context


if __name__ == "__main__":
    sys.exit(main())
