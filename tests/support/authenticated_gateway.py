"""A gateway with authentication and two robots, of which restricted callers see only one."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from browser import Browser
from issuer import AUDIENCE, CLIENT, SECRET, Issuer
from linked_fleet_identity.__main__ import new_token
from running import Process, eventually, process
from small_fleet import Place, live

ALL = ("read", "subscribe", "stop", "act", "reset", "admin")
SEEN, HIDDEN = "lab-1", "hall-1"
"""The robots; restricted callers see only ``lab-*``."""
PATIENCE_S = 15.0


@dataclass
class AuthenticatedGateway:
    """``tables``: the present tables of the identity file by name; ``tokens`` by name."""

    place: Place
    file: Path
    gateway: Process | None = None
    tables: dict[str, str] = field(default_factory=dict)
    tokens: dict[str, str] = field(default_factory=dict)

    @property
    def root(self) -> str:
        return self.place.root

    def add(self, name: str, *scopes: str, robots: tuple[str, ...] = ("*",), expires: str = "") -> None:
        self.tokens[name], self.tables[name] = new_token(name, scopes, robots, expires)
        self.write()

    def admit(self, issuer: Issuer, *scopes: str, robots: str = "*") -> None:
        """Add operators from ``issuer``."""
        secret = self.file.with_name("secret")
        secret.write_text(SECRET)
        self.tables["issuer"] = (
            f'[[issuer]]\nname = "plant"\nurl = "{issuer.url}"\naudience = "{AUDIENCE}"\n'
            f'client_id = "{CLIENT}"\nclient_secret_file = "secret"\n'
            f'[[issuer.grant]]\nclaim = "groups"\nvalue = "operators"\n'
            f'scopes = {list(scopes)}\nrobots = ["{robots}"]\n'
        )
        self.write()

    def revoke(self, name: str) -> None:
        del self.tables[name]
        self.write()

    def write(self, text: str | None = None) -> None:
        """Replace the file atomically, as an editor or a mounted secret does."""
        new = self.file.with_suffix(".new")
        new.write_text("\n".join(self.tables.values()) if text is None else text)
        new.replace(self.file)

    @contextlib.contextmanager
    def browsing(self, name: str | None) -> Iterator[Browser]:
        """Return a client with the token of that name."""
        with contextlib.closing(Browser(self.root)) as browser:
            if name is not None:
                browser.http.headers["authorization"] = f"Bearer {self.tokens[name]}"
            yield browser

    def known(self, name: str) -> None:
        """Wait until the gateway has loaded the token."""
        with self.browsing(name) as browser:
            eventually(lambda: browser.http.get(self.root).status_code != 401, f"{name} known")


@contextlib.contextmanager
def run_with_driver(folder: Path) -> Iterator[AuthenticatedGateway]:
    """Run a gateway with somebody who administers it, and somebody who reads and acts."""
    with run_authenticated(folder) as one:
        one.add("admin", *ALL)
        one.add("driver", "read", "act")
        one.known("driver")
        yield one


@contextlib.contextmanager
def run_authenticated(
    folder: Path, *more: str, robots: bool = True, issuer: Issuer | None = None
) -> Iterator[AuthenticatedGateway]:
    place, file = Place(folder / "state"), folder / "identities.toml"
    here = AuthenticatedGateway(place, file)
    here.add("root", *ALL)
    if issuer is not None:
        here.admit(issuer, "read", "subscribe", "act")
    flags = ("--identities", str(file), *more)
    names = (f"--robot={SEEN}=ur5", f"--robot={HIDDEN}=ur5")
    with contextlib.ExitStack() as stack:
        here.gateway = stack.enter_context(process(*place.command(), *flags))
        if robots:
            stack.enter_context(process("-m", "linked_fleet_agent", *names, "--connect", place.zenoh))
        here.gateway.said("serving")
        with here.browsing("root") as browser:
            for name in (SEEN, HIDDEN) if robots else ():
                live(browser, name)
        yield here
