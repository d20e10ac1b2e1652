"""``linked-fleet``: look at a fleet, watch it and have it move, from a shell.

Exit codes: 0 done, 1 the action failed or was refused, 2 wrong usage, 3 the server cannot be reached or understood,
4 there is no such thing, 130 interrupted.
"""

import argparse
import os
import sys
from collections.abc import Callable, Sequence

from client.cli import act, completion, look, show, watch
from client.cli.given import BadArgument
from client.errors import BadAnswer, ClientError, NoSuchThing, Problem, Unreachable
from client.fleet import Fleet

DEFAULT_URL = "http://127.0.0.1:8000/"
OK, REFUSED, USAGE, UNREACHABLE, NO_SUCH_THING, INTERRUPTED = 0, 1, 2, 3, 4, 130
_GONE = frozenset({404, 410})


def main(argv: Sequence[str] | None = None) -> int:
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments[:1] == ["conform"]:
        from client.conform import command  # has options of its own, and nothing else needs it

        return int(command(arguments[1:]))
    options = _options(arguments)
    try:
        return int(options.run(options))
    except ClientError as error:
        print(f"linked-fleet: {_safe(error)}", file=sys.stderr)
        return exit_code(error)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # whoever read us has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = _parser()
    options, more = parser.parse_known_args(arguments)
    # argparse takes what an action takes only in one piece, and people put options in between
    if any(each.startswith("-") for each in more) or (more and options.command != "do"):
        parser.error(f"unrecognized arguments: {' '.join(more)}")
    if more:
        options.arguments += more
    return options


def exit_code(error: ClientError) -> int:
    if isinstance(error, NoSuchThing) or (isinstance(error, Problem) and error.status in _GONE):
        return NO_SUCH_THING
    if isinstance(error, Unreachable | BadAnswer) or (isinstance(error, Problem) and error.status >= 500):
        return UNREACHABLE
    return USAGE if isinstance(error, BadArgument) else REFUSED


def _safe(error: ClientError) -> str:
    return "\n".join(show.clean(line) for line in str(error).splitlines())


def _parser() -> argparse.ArgumentParser:
    common = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    _everywhere(common)
    units = argparse.ArgumentParser(add_help=False)
    units.add_argument("--unit", action="append", default=[], help="show values in this unit, such as deg or mm")
    parser = argparse.ArgumentParser(
        prog="linked-fleet", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    _everywhere(parser)
    parser.set_defaults(url=_default_url(), json=False, timeout=10.0)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(
        name: str, run: Callable[[Fleet, argparse.Namespace], int], about: str, *parents: argparse.ArgumentParser
    ) -> argparse.ArgumentParser:
        found = commands.add_parser(name, help=about, description=about, parents=[common, *parents])
        found.set_defaults(run=lambda options: _with_fleet(run, options))
        return found

    ls = command("ls", look.ls, "what there is", units)
    ls.add_argument("path", nargs="?", default="", help="titles with slashes between, such as baxter/right_s1")
    ls.add_argument("--values", action="store_true", help="read each part for what it measures")
    get = command("get", look.get, "values with their units, and actions with what they take", units)
    get.add_argument("path", nargs="?", default="")
    seen = command("watch", watch.watch, "values as they change", units)
    seen.add_argument("paths", nargs="+", metavar="path")
    seen.add_argument("--count", type=_count, help="end after so many changes")
    seen.add_argument("--interval", type=_positive, help="at least so many seconds between two changes")
    seen.add_argument("--seconds", type=_positive, help="end after so many seconds")
    _acting(command)
    _around(commands)
    return parser


def _everywhere(parser: argparse.ArgumentParser) -> None:
    """What may stand before the command as well as after it."""
    parser.add_argument("--url", help="where the fleet is (or LINKED_FLEET_URL); the token is in LINKED_FLEET_TOKEN")
    parser.add_argument("--json", action="store_true", default=argparse.SUPPRESS, help="JSON, for scripts")
    parser.add_argument("--timeout", type=_positive, metavar="S", help="seconds to wait for the server")


def _acting(command: Callable[..., argparse.ArgumentParser]) -> None:
    do = command("do", act.do, "have an action done and wait for its end; Ctrl-C has it cancelled")
    do.add_argument("path")
    do.add_argument("action")
    do.add_argument("arguments", nargs="*", metavar="name=value", help="what it takes, as `get` says")
    do.add_argument("--dry-run", action="store_true", help="have it judged, and not done")
    do.add_argument("--idempotency-key", metavar="KEY", help="the same command with the same key is done once")
    stop = command("stop", act.stop, "have a thing stopped by its own action for that, everything if none is named")
    stop.add_argument("path", nargs="?", default="")
    for each in (do, stop):
        each.add_argument("--wait", action=argparse.BooleanOptionalAction, default=True)
        each.add_argument("--seconds", type=_positive, help="wait no longer than this; it goes on")


def _around(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    script = commands.add_parser("completion", help="a script for tab completion: eval it in your shell")
    script.add_argument("shell", choices=sorted(completion.SCRIPTS))
    script.set_defaults(run=lambda options: print(completion.SCRIPTS[options.shell]) or OK)
    commands.add_parser("conform", help="check a server against the paper; see `linked-fleet conform --help`")
    hidden = commands.add_parser("complete")
    hidden.add_argument("words", nargs="*")
    hidden.set_defaults(run=_complete)


def _complete(options: argparse.Namespace) -> int:
    print("\n".join(completion.completions(options.words, _default_url())))
    return OK


def _with_fleet(run: Callable[[Fleet, argparse.Namespace], int], options: argparse.Namespace) -> int:
    with Fleet(options.url, options.timeout, token=os.environ.get("LINKED_FLEET_TOKEN", "")) as fleet:
        return run(fleet, options)


def _default_url() -> str:
    return os.environ.get("LINKED_FLEET_URL") or DEFAULT_URL


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text} is no number of seconds")
    return value


def _count(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not at least one")
    return value


if __name__ == "__main__":
    sys.exit(main())
