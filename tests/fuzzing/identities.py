"""Credentials, logins and handshakes at a real gateway with TLS and authentication: nobody may gain foreign rights."""

import asyncio
import contextlib
import ssl
import tempfile
from collections.abc import Iterator
from pathlib import Path
from random import Random
from urllib.parse import urlencode

import httpx

from authenticated_gateway import ALL, AuthenticatedGateway
from certificates import made
from fuzzing import mutation
from fuzzing.credentials import COOKIE, SUBJECT, CredentialSamples
from fuzzing.findings import Tally, random_of
from fuzzing.http import AT_ONCE, Line, broken
from fuzzing.living import PATIENCE_S, LiveGateway, in_batches
from issuer import issuing
from running import process
from small_fleet import Place

_ASKED = (
    ("GET", "/"), ("GET", "/"), ("GET", "/linkset"), ("HEAD", "/"), ("GET", "/metrics"), ("GET", "/audit"),
    ("POST", "/actions/stopAll"), ("GET", "/nothing"), ("DELETE", "/audit"),
)  # fmt: skip
_OPEN_TO = {
    "/": {"root", "reader", SUBJECT}, "/linkset": {"root", "reader", SUBJECT}, "/metrics": {"root"}, "/audit": {"root"},
    "/actions/stopAll": {"root", SUBJECT},
}  # fmt: skip
_SCHEMES = ("Bearer", "Bearer", "Bearer", "Bearer", "bearer", "BEARER", "Basic", "DPoP", "", "Bearer Bearer", "Bearer,")
_THEN = ("/", "//evil.example/", "https://evil.example/", "/\\evil.example", "/" + "x" * 3000, "é", "\r\nX: y", "/?a=b")


def run(count: int, seed: int, first: int = 0) -> Tally:
    with living() as there:
        crowd = Crowd(there)
        return in_batches("identities", count, seed, first, there, crowd.send)


class Known(LiveGateway):
    """A gateway with authentication."""

    def __init__(self, here: AuthenticatedGateway, wallet: CredentialSamples, tls: ssl.SSLContext) -> None:
        assert here.gateway is not None
        super().__init__(here.place, here.gateway, None)  # type: ignore[arg-type]  # (there are no robots)
        self.wallet, self.tls, self.root = wallet, tls, f"https://127.0.0.1:{here.place.port}"

    def probe(self) -> None:
        """Check that valid credentials still work, and that requests without credentials are refused."""
        with self.client() as http:
            for text in (*self.wallet.tokens.values(), self.wallet.jwt):
                status = http.get("/", headers={"authorization": f"Bearer {text}"}).status_code
                assert status == 200, f"a good token is answered with {status}"
            assert http.get("/").status_code == 401, "nobody is let in"

    @contextlib.contextmanager
    def client(self) -> Iterator[httpx.Client]:
        try:
            with httpx.Client(base_url=self.root, verify=self.tls, timeout=PATIENCE_S) as http:
                yield http
        except httpx.HTTPError as error:
            raise AssertionError(f"the gateway does not answer: {error!r}") from error

    def log_in(self) -> None:
        """Create sessions, and a pending login."""
        for who, token in (*self.wallet.tokens.items(), (SUBJECT, self.wallet.jwt)):
            with self.client() as http:
                http.post("/login", data={"token": token, "then": "/"}, headers={"origin": self.root})
                self.wallet.cookies[who] = http.cookies[COOKIE]
        with self.client() as http:
            http.get("/login/start?issuer=plant&then=/")
            self.wallet.underway = http.cookies[COOKIE + "-login"]


@contextlib.contextmanager
def living() -> Iterator[Known]:
    with tempfile.TemporaryDirectory() as folder, issuing() as issuer:
        here = AuthenticatedGateway(Place(Path(folder) / "state"), Path(folder) / "identities.toml")
        here.add("root", *ALL)
        here.add("reader", "read")
        here.admit(issuer, "read", "subscribe", "act")
        keys = made(Path(folder) / "tls", "--router", "127.0.0.1")
        flags = ("--identities", str(here.file), "--tls-cert", str(keys / "router.pem"))
        with process(*here.place.command(), *flags, "--tls-key", str(keys / "router.key")) as here.gateway:
            here.gateway.said("serving")
            known = Known(
                here, CredentialSamples(issuer, dict(here.tokens)), ssl.create_default_context(cafile=keys / "ca.pem")
            )
            known.log_in()
            yield known


class Private(Line):
    """A TLS connection from a loopback address of its own, by which failed logins are counted."""

    def __init__(self, there: Known) -> None:
        super().__init__(there.port)
        self._tls = there.tls
        self.address, self.status = "127.0.0.1", 0

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        return await asyncio.open_connection(
            "127.0.0.1", self._port, limit=2**20, ssl=self._tls, local_addr=(self.address, 0)
        )

    async def _exchange(self, said: bytes, head: bool) -> tuple[int, bool]:
        self.status, keep = await super()._exchange(said, head)
        return self.status, keep


class Crowd:
    """A few concurrent clients."""

    def __init__(self, there: Known) -> None:
        self._there, self._wallet = there, there.wallet

    def send(self, tally: Tally, batch: range) -> None:
        asyncio.run(self._all(tally, batch))

    async def _all(self, tally: Tally, batch: range) -> None:
        numbers = iter(batch)
        await asyncio.gather(*(self._client(tally, numbers) for _ in range(AT_ONCE)))

    async def _client(self, tally: Tally, numbers: Iterator[int]) -> None:
        line = Private(self._there)
        try:
            for number in numbers:
                random = random_of(tally.seed, number)
                if random.random() < 0.1:
                    said = self.handshake(random)
                    wrong = await broken(self._there.port, said)
                elif random.random() < 0.2:
                    said, wrong = await self._login(line, random)
                else:
                    said, wrong = await self._asked(line, random)
                if wrong:
                    tally.found(wrong, number, 1, repr(said))
        finally:
            line.close()

    async def _asked(self, line: Private, random: Random) -> tuple[bytes, str]:
        method, path = random.choice(_ASKED)
        fields, who = self.credential(random)
        if random.random() < 0.3:
            fields.append(f"Origin: {random.choice((self._there.root, 'null', 'https://evil.example', ''))}")
        if random.random() < 0.2:
            fields.append(f"Accept: {random.choice(('text/html', 'text/event-stream', 'text/turtle', 'x'))}")
        said = self._request(method, path, fields)
        wrong = await line.ask(said, method == "HEAD")
        let_in = 200 <= line.status < 300 or line.status == 304
        if not wrong and let_in and who not in _OPEN_TO.get(path, ()):
            wrong = f"{method} {path} is answered with {line.status} to {who or 'nobody'}"
        return said, wrong

    def credential(self, random: Random) -> tuple[list[str], str | None]:
        """Return fields and their owner: Authorization overrides all others, and is valid only once."""
        if random.random() < 0.5:
            said, who = self._wallet.cookie(random)
            return [f"Cookie: {said}"], who
        text, who = self._wallet.bearer(random)
        scheme, between = random.choice(_SCHEMES), random.choice((" ", " ", " ", " ", "  ", "\t", ""))
        value = f"{scheme}{between}{text}"
        fields = [f"Authorization: {value}"] * random.choice((1, 1, 1, 1, 1, 2))
        found, _, rest = value.strip(" \t").partition(" ")
        if len(fields) > 1 or found.lower() != "bearer":
            return fields, None
        return fields, who if rest.strip() == text.strip() else self._wallet.whose(rest)

    async def _login(self, line: Private, random: Random) -> tuple[bytes, str]:
        """Return a login form, a response of the issuer, or a logout, which ends a session."""
        line.close()
        line.address = f"127.{random.randrange(256)}.{random.randrange(256)}.{random.randrange(1, 255)}"
        how, origin, who = random.random(), f"Origin: {self._there.root}", None
        if how < 0.6:
            text, who = self._wallet.bearer(random)
            form = [("token", text), ("then", random.choice(_THEN))] * random.choice((1, 1, 1, 2))
            body = urlencode(form[: random.choice((1, 2, 2, 2, 4))], encoding="latin-1", errors="replace").encode()
            if random.random() < 0.3:
                body, who = mutation.raw(random, body), "whoever"
            media_type = random.choice(
                ("application/x-www-form-urlencoded",) * 4 + ("text/plain", "multipart/form-data")
            )
            said = self._request("POST", "/login", [origin, f"Content-Type: {media_type}"], body)
        elif how < 0.9:
            code, state = random.choice(("x", "", "é", "x" * 3000)), random.choice((self._wallet.state, "x"))
            query = {"code": code, "state": state, "iss": self._wallet.issuer.url}
            query = mutation.tree(random, query) if random.random() < 0.7 else query
            path = "/login/return?" + urlencode(query, doseq=random.random() < 0.5, errors="replace")
            if random.random() < 0.3:
                path = "/login/start?" + urlencode({"issuer": "plant", "then": random.choice(_THEN)})
                who = "whoever"  # the user at the issuer is unknown
            said = self._request("GET", path, [f"Cookie: {self._wallet.login_cookie(random)}"])
        else:
            said, who = self._request("POST", "/logout", [origin, "Cookie: a=b"]), "whoever"
        wrong = await line.ask(said, False)
        if not wrong and line.status == 303 and who is None:
            wrong = "somebody is logged in whom nobody knows"
        line.close()
        line.address = "127.0.0.1"
        return said, wrong

    def _request(self, method: str, path: str, fields: list[str], body: bytes = b"") -> bytes:
        lines = [f"{method} {path} HTTP/1.1", f"Host: 127.0.0.1:{self._there.port}", *fields]
        if method == "POST":
            lines.append(f"Content-Length: {len(body)}")
        return "\r\n".join(lines).encode("latin-1", "replace") + b"\r\n\r\n" + body

    def handshake(self, random: Random) -> bytes:
        """Return bytes for the TLS port: a mutated hello, possibly followed by data, or no TLS at all."""
        if random.random() < 0.2:
            return self._request("GET", "/", [])
        incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        with contextlib.suppress(ssl.SSLWantReadError):
            self._there.tls.wrap_bio(incoming, outgoing, server_hostname="127.0.0.1").do_handshake()
        hello = outgoing.read()
        said = mutation.raw(random, hello) if random.random() < 0.8 else hello
        return said + random.choice(
            (b"", b"", hello, b"\x15\x03\x03\0\x02\x02\x28", b"\x17\x03\x03\xff\xff" + b"x" * 999)
        )
