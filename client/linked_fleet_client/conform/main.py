"""`linked-fleet conform URL`: checks a server against the requirements of the paper."""

import asyncio
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from linked_fleet_client.conform.rdf import untrusted_input
from linked_fleet_client.conform.report import Report, as_json, earl, table
from linked_fleet_client.conform.requirements import check_all
from linked_fleet_client.conform.subject import Subject, Trials, target, try_callbacks, try_streams
from linked_fleet_client.conform.walk import Page, Walk, read, walk
from linked_fleet_client.conform.web import OutOfTimeError, Web

_CONFORMS, _BREAKS, _UNREACHABLE = 0, 1, 3


@dataclass(frozen=True)
class Options:
    """The server, and the bounds of the check."""

    url: str
    callback_host: str
    no_write: bool
    resources: int
    timeout: float
    limit: float


def command(argv: Sequence[str]) -> int:
    """Run the check.

    Return 0 if no MUST failed, 1 if one did, 3 if the server is unreachable; usage errors exit with 2.
    """
    try:
        return int(cli.main(list(argv), "linked-fleet conform", standalone_mode=False))
    except click.ClickException as error:
        error.show()
        raise SystemExit(error.exit_code) from error


def _duration_s(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = 0.0
    if not 0.1 <= seconds <= 86_400:
        raise click.BadParameter(f"{text} is not between 0.1 and 86400 seconds")
    return seconds


@click.command("conform", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("url")
@click.option(
    "--earl", "earl_file", metavar="FILE", type=click.Path(path_type=Path), help="Write EARL in Turtle there."
)
@click.option("--json", "json_", is_flag=True, help="Print JSON instead of a table.")
@click.option(
    "--callback-host", metavar="HOST", default="127.0.0.1", help="An address of this machine that the server can reach."
)
@click.option("--no-write", is_flag=True, help="Send no bodies and make no callbacks.")
@click.option("--resources", metavar="N", type=click.IntRange(min=1), default=200, help="Visit at most so many (200).")
@click.option(
    "--token-file",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Has the token that says who you are (or LINKED_FLEET_TOKEN).",
)
@click.option("--timeout", metavar="S", type=_duration_s, default=10.0, help="Seconds for one request (10).")
@click.option("--limit", metavar="S", type=_duration_s, default=300.0, help="Seconds for everything (300).")
def cli(earl_file: Path | None, json_: bool, token_file: Path | None, **options: Any) -> int:
    """Check the server whose root is URL against the paper."""
    checked = Options(**options)
    try:
        with untrusted_input():
            report = asyncio.run(conform(checked, _token(token_file)))
    except ValueError as error:
        raise click.UsageError(str(error)) from error
    except ConnectionError as error:
        print(f"{checked.url} cannot be reached: {error}", file=sys.stderr)
        return _UNREACHABLE
    print(as_json(report) if json_ else table(report))
    if earl_file:
        try:
            earl_file.write_text(earl(report), encoding="utf-8")
        except OSError as error:
            raise click.UsageError(f"{earl_file} cannot be written: {error}") from error
    return _BREAKS if report.violates_must else _CONFORMS


def _token(file: Path | None) -> str:
    """Return the token in the file, else in the environment; never from arguments, which other users can read.

    Empty if there is none. Raises ValueError if it is malformed.
    """
    try:
        said = os.environ.get("LINKED_FLEET_TOKEN", "") if file is None else file.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{file} cannot be read as a token") from error
    token = said.strip()
    if (file is not None and not token) or not all("!" <= each <= "~" for each in token):
        raise ValueError(f"what is in {file or 'LINKED_FLEET_TOKEN'} is not a token")
    return token


async def conform(options: Options, token: str = "") -> Report:
    """Check a server. Raises ConnectionError if it cannot be reached, ValueError if the URL is invalid."""
    async with Web(options.url, options.timeout, options.limit, token) as web:
        root = await _root(web)
        found = await walk(web, root, options.resources)
        trials = await _trials(web, found, options)
        subject = Subject(web, found, trials, writes=not options.no_write)
        extent = f"{subject.extent()}{f', {found.truncation_reason}' if found.truncation_reason else ''}"
        return Report(web.root, datetime.now(UTC), extent, await check_all(subject))


async def _root(web: Web) -> Page:
    root = await read(web, web.root)
    if root.answer.unreached:
        raise ConnectionError(root.answer.fault)
    return root


async def _trials(web: Web, found: Walk, options: Options) -> Trials:
    trials = Trials(*target(found))
    if options.no_write:
        trials.excuse = "left out because of --no-write"
    try:
        await try_streams(web, trials)
        if not options.no_write:
            await try_callbacks(web, found, trials, options.callback_host)
    except OutOfTimeError as error:
        trials.excuse = str(error)
    return trials
