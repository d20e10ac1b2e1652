"""``linked-fleet``: read, watch and move a fleet from a shell."""

import os
import sys
import warnings
from collections.abc import Sequence
from typing import Any

import click

from linked_fleet_client.cli import output, programs
from linked_fleet_client.cli.description import get, ls
from linked_fleet_client.cli.invoke import BadArgument, do, stop
from linked_fleet_client.cli.mission import mission
from linked_fleet_client.cli.options import Session, add_common_options, completion
from linked_fleet_client.cli.watch import watch
from linked_fleet_client.errors import BadAnswer, ClientError, NoSuchThing, Problem, Unreachable

OK, REFUSED, USAGE, UNREACHABLE, NO_SUCH_THING, INTERRUPTED = 0, 1, 2, 3, 4, 130
_GONE = frozenset({404, 410})
_NO_FLEET = frozenset({400, 404, 405, 406, 410, 421, 426})
HINT = "If the fleet is elsewhere, give its address with --url or in LINKED_FLEET_URL."


class _Commands(click.Group):
    """Commands of the client, and programs of other packages (``programs.py``).

    Errors of the client become exit codes. ``conform`` is imported on demand, because that takes long.
    """

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [*super().list_commands(ctx), "conform", *programs.names()]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name == "conform":
            from linked_fleet_client.conform.main import cli as conform

            return conform
        return super().get_command(ctx, cmd_name) or programs.program(cmd_name)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except ClientError as error:
            print(f"linked-fleet: {_safe(error)}", file=sys.stderr)
            if _is_elsewhere(error, ctx.find_object(Session)):
                print(HINT, file=sys.stderr)
            return exit_code(error)
        except KeyboardInterrupt:
            return INTERRUPTED
        except BrokenPipeError:  # the reader of the output has closed it
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return OK


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@add_common_options
def cli() -> None:
    """Read, watch and move a fleet; run a gateway, an agent or the demo; check what is wrong.

    Exit codes: 0 done, 1 the action failed or was refused, 2 wrong usage, 3 the server cannot be reached or understood,
    4 there is no such thing, 130 interrupted.
    """


for _command in (ls, get, watch, do, stop, mission, completion):
    cli.add_command(_command)


def main(argv: Sequence[str] | None = None) -> int:
    warnings.filterwarnings("ignore", "Parsing weird boolean")  # of rdflib; such a literal is ignored here
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        return int(cli.main(arguments, "linked-fleet", standalone_mode=False) or OK)
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except click.Abort:
        return INTERRUPTED


def exit_code(error: ClientError) -> int:
    if isinstance(error, NoSuchThing) or (isinstance(error, Problem) and error.status in _GONE):
        return NO_SUCH_THING
    if isinstance(error, Unreachable | BadAnswer) or (isinstance(error, Problem) and error.status >= 500):
        return UNREACHABLE
    return USAGE if isinstance(error, BadArgument) else REFUSED


def _is_elsewhere(error: ClientError, session: Session | None) -> bool:
    """Return True if the address of the fleet is asked, has given nothing, and may be that of another server."""
    if session is None or session.has_read:
        return False
    if isinstance(error, Problem):
        return error.status in _NO_FLEET and session.authority in error.url
    return isinstance(error, Unreachable | BadAnswer) and session.authority in str(error)


def _safe(error: ClientError) -> str:
    return "\n".join(output.clean(line) for line in str(error).splitlines())


if __name__ == "__main__":
    sys.exit(main())
