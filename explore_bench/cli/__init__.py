"""The command line: the group of all commands, and one line on stderr for whatever is wrong."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import click

from explore_bench.cli.check import check
from explore_bench.cli.compare import compare
from explore_bench.cli.demo import demo
from explore_bench.cli.gate import gate
from explore_bench.cli.list_ import list_
from explore_bench.cli.merge import merge
from explore_bench.cli.new import new
from explore_bench.cli.options import DONE, INTERRUPTED, WRONG
from explore_bench.cli.perf import perf
from explore_bench.cli.report import report
from explore_bench.cli.run import run
from explore_bench.cli.submit import submit
from explore_bench.cli.train import train
from explore_bench.cli.verify import verify
from explore_bench.errors import RequestError, one_line

KEPT = {"run": "what is done is stored, the same command goes on"}
"""What an interrupted verb leaves behind, where it does not begin anew; `train` says so itself."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the console script: one line on stderr for whatever is wrong, and the exit code."""
    code = DONE
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    try:
        with _terminated_like_ctrl_c():
            code = cli.main(args=arguments or ["--help"], prog_name="explore-bench", standalone_mode=False) or DONE
    except click.ClickException as error:
        code = _complain(error.format_message())
    except RequestError as error:
        code = _complain(str(error))
    except (click.Abort, KeyboardInterrupt):
        verb = next((word for word in arguments if word in cli.commands), "")
        print(f"explore-bench: interrupted; {KEPT.get(verb, 'the same command begins anew')}.", file=sys.stderr)
        code = INTERRUPTED
    sys.exit(code)


@contextmanager
def _terminated_like_ctrl_c() -> Iterator[None]:
    """Raise KeyboardInterrupt in the block where the process is told to end: what is done is kept and written."""
    if threading.current_thread() is not threading.main_thread():  # which alone may say what a signal does
        yield
        return

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    previous = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


def _complain(sentence: str) -> int:
    print(f"explore-bench: {one_line(sentence)}", file=sys.stderr)
    return WRONG


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="explore-bench")
def cli() -> None:
    """Compare robot-exploration strategies: paired, seeded trials in one simulator, tables with intervals."""


for command in (list_, run, merge, report, verify, compare, submit, gate, new, check, demo, train, perf):
    cli.add_command(command)
