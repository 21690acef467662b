"""`new`: the file of a strategy to begin with, and its test."""

from __future__ import annotations

import keyword
import re
from pathlib import Path
from string import Template

import click

from explore_bench.cli.options import DONE
from explore_bench.errors import RequestError, writing

STRATEGY = Template('''\
"""$name: a strategy for explore-bench."""


class $name:
    """Drives to the nearest candidate."""

    def reset(self, rng):
        """Begin a trial: draw from `rng` alone, and keep nothing from the trial before."""

    def choose(self, observation):
        """Return the index of the candidate to drive to next."""
        # Of each candidate: observation.positions [m], .paths (cells) and .path_lengths [m]. What the robot knows:
        # observation.belief, whose predict(path).uncertainty says how uncertain it would be at the end of a path.
        return int(observation.path_lengths.argmin())
''')

TEST = Template('''\
"""Whether $name keeps the contract of a strategy, rule by rule: run by pytest."""

from pathlib import Path

import explore_bench

STRATEGY = f"{Path(__file__).with_name('$file')}:$name"


def test_it_keeps_the_contract():
    broken = [str(finding) for finding in explore_bench.check(STRATEGY) if not finding.ok]
    assert not broken, "\\n".join(broken)
''')


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
def new(file: Path) -> int:
    """Write FILE.py, a strategy of a dozen lines to begin with, and test_FILE.py beside it."""
    name = _class_name(file)
    test = file.with_name(f"test_{file.name}")
    for path in (file, test):
        if path.exists() or path.is_symlink():
            raise RequestError(f"'{path}' is there already, and is left as it is; give another name.")
    parts = {"name": name, "file": file.name}
    written: list[Path] = []
    try:
        for path, template in ((file, STRATEGY), (test, TEST)):
            with writing(path), path.open("x", encoding="utf-8") as stream:
                written.append(path)
                stream.write(template.substitute(parts))
    except RequestError:
        for path in written:
            path.unlink(missing_ok=True)
        raise
    shown = f"{file}" if file.is_absolute() else f"./{file}"
    click.echo(f"{file}: the strategy {name}, and {test}, its test. Next:")
    click.echo(f"  explore-bench check {shown}:{name}")
    click.echo(f"  explore-bench run smoke -s {shown}:{name} -s random --results {file.stem}")
    click.echo(f"  explore-bench report --results {file.stem}")
    click.echo("run with --map FILE explores a map of your own; give each map another folder of results.")
    return DONE


def _class_name(file: Path) -> str:
    """Name of the class in a file: my_strategy.py has MyStrategy.

    Raises
    ------
    RequestError : where the file's name gives none.
    """
    stem = file.stem
    name = "".join(part[:1].upper() + part[1:] for part in stem.split("_"))
    if file.suffix != ".py" or not re.fullmatch(r"[A-Za-z_]\w*", stem, re.ASCII) or not name.isidentifier():
        raise RequestError(f"'{file}' is no name of a strategy's file; take letters, digits and _, like mine.py.")
    if keyword.iskeyword(name):
        raise RequestError(f"'{file}' would hold a class '{name}', a word of Python; give another name.")
    return name
