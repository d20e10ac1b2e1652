"""`linked-fleet conform URL`: whether a server does what the paper asks."""

import argparse
import asyncio
import os
import sys
from datetime import UTC, datetime
from pathlib import Path

from client.conform.rdf import wary
from client.conform.report import Report, as_json, earl, table
from client.conform.requirements import check_all
from client.conform.subject import Subject
from client.conform.trials import Trials, target, try_callbacks, try_streams
from client.conform.walk import Page, Walk, read, walk
from client.conform.web import OutOfTimeError, Web

_CONFORMS, _BREAKS, _UNREACHABLE = 0, 1, 3


def command(argv: list[str]) -> int:
    """0 when no must failed, 1 when one did, 2 on wrong usage, 3 when the server cannot be reached."""
    parser = _parser()
    options = parser.parse_args(argv)
    try:
        with wary():
            report = asyncio.run(conform(options, _token(options.token_file)))
    except ValueError as error:
        parser.error(str(error))
    except ConnectionError as error:
        print(f"{options.url} cannot be reached: {error}", file=sys.stderr)
        return _UNREACHABLE
    print(as_json(report) if options.json else table(report))
    if options.earl:
        try:
            options.earl.write_text(earl(report), encoding="utf-8")
        except OSError as error:
            parser.error(f"{options.earl} cannot be written: {error}")
    return _BREAKS if report.breaks else _CONFORMS


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("linked-fleet conform", description=__doc__)
    parser.add_argument("url", metavar="URL", help="the root of the server")
    parser.add_argument("--earl", metavar="FILE", type=Path, help="write the results there, as EARL in Turtle")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument(
        "--callback-host",
        metavar="HOST",
        default="127.0.0.1",
        help="an address of this machine that the server can reach",
    )
    parser.add_argument("--no-write", action="store_true", help="send no bodies and make no callbacks")
    parser.add_argument("--resources", metavar="N", type=_positive, default=200, help="how many to visit at most (200)")
    parser.add_argument(
        "--token-file", metavar="FILE", type=Path, help="has the token that says who you are (or LINKED_FLEET_TOKEN)"
    )
    parser.add_argument("--timeout", metavar="S", type=_duration_s, default=10.0, help="seconds for one request (10)")
    parser.add_argument("--limit", metavar="S", type=_duration_s, default=300.0, help="seconds for everything (300)")
    return parser


def _positive(text: str) -> int:
    if (number := int(text)) < 1:
        raise argparse.ArgumentTypeError("at least 1")
    return number


def _duration_s(text: str) -> float:
    if not 0.1 <= (seconds := float(text)) <= 86_400:
        raise argparse.ArgumentTypeError("between 0.1 and 86400 seconds")
    return seconds


def _token(file: Path | None) -> str:
    """Of the file, else of the environment; not of the arguments, which everybody on the machine can read.

    Empty without any; ValueError for what is none.
    """
    try:
        said = os.environ.get("LINKED_FLEET_TOKEN", "") if file is None else file.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{file} cannot be read as a token") from error
    token = said.strip()
    if (file is not None and not token) or not all("!" <= each <= "~" for each in token):
        raise ValueError(f"what is in {file or 'LINKED_FLEET_TOKEN'} is no token")
    return token


async def conform(options: argparse.Namespace, token: str = "") -> Report:
    """ConnectionError when there is no connection to the server, ValueError when the URL is none."""
    async with Web(options.url, options.timeout, options.limit, token) as web:
        root = await _root(web)
        found = await walk(web, root, options.resources)
        trials = await _trials(web, found, options)
        subject = Subject(web, found, trials, writes=not options.no_write)
        extent = f"{subject.extent()}{f', {found.cut}' if found.cut else ''}"
        return Report(web.root, datetime.now(UTC), extent, await check_all(subject))


async def _root(web: Web) -> Page:
    root = await read(web, web.root)
    if root.answer.unreached:
        raise ConnectionError(root.answer.fault)
    return root


async def _trials(web: Web, found: Walk, options: argparse.Namespace) -> Trials:
    trials = Trials(*target(found))
    if options.no_write:
        trials.excuse = "left out, for nothing may be written (--no-write)"
    try:
        await try_streams(web, trials)
        if not options.no_write:
            await try_callbacks(web, found, trials, options.callback_host)
    except OutOfTimeError as error:
        trials.excuse = str(error)
    return trials
