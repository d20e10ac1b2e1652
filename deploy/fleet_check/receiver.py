"""Receives callbacks: POSTs are stored, and a GET returns all of them as JSON. Uses only the standard library."""

import json
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

_deliveries: list[dict[str, str]] = []


class Receiver(BaseHTTPRequestHandler):
    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        _deliveries.append({"id": self.headers.get("webhook-id", ""), "body": body.decode()})
        self.send_response(204)
        self.end_headers()

    def do_GET(self) -> None:
        body = json.dumps(_deliveries).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Log nothing, because deliveries are read by GET."""


if __name__ == "__main__":
    ThreadingHTTPServer(("", 9000), Receiver).serve_forever()
