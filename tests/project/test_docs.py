"""Every explore-bench command of README.md, submissions/ and docs/ is executed, slow blocks after `<!-- slow -->`.

Shell commands stand in blocks tagged `console`, each on a line that begins with `$ ` (a backslash continues it), and
`# exits N` behind one that is to end with another exit code than 0. A block of Python or TOML whose first line is a
comment with a file's name is written to that file. The blocks of a page run in order in one folder that holds copies
of `examples/` and `results/reference/`, and the environment as `.venv`. Of the quick blocks `explore-bench` is called
in this process, which has imported and compiled everything; once in a while, with the slow tests, every block is run by
a shell, as a reader would. What is to be true of the files that some of them leave is in left_by_pages.py.
"""

import contextlib
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import click
import pytest
from left_by_pages import LEFT

from explore_bench.cli import cli, main

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "submissions" / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"(?P<slow>^<!-- slow -->\n\n?)?^```(?P<tag>\w*)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"# (?P<name>[\w./-]+\.(py|toml|yml))\n")
EXITS = re.compile(r"\s+# exits (\d+)$")
SECONDS = 900


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: a script to run, or a file to write."""

    slow: bool
    body: str
    file: str | None = None


def commands(body):
    """Return the commands of a console block, continued lines joined."""
    joined = re.sub(r"\\\n", " ", body)
    return [line[2:] for line in joined.splitlines() if line.startswith("$ ")]


def blocks(text):
    """Return what is to be written or run of a page, in order."""
    found = []
    for match in FENCE.finditer(text):
        body, slow = match["body"], bool(match["slow"])
        if match["tag"] == "console":
            found.append(Block(slow, body))
        elif match["tag"] in ("python", "toml") and (named := NAMED.match(body)):
            found.append(Block(slow, body, named["name"]))
    return found


def script(body):
    """Return the shell script of a block: it ends at the first command with another exit code than the page says."""
    lines = ["set -euo pipefail"]
    for command in commands(body):
        if exits := EXITS.search(command):
            told = command[: exits.start()]
            lines.append(f"code=0; {told} || code=$?; test $code -eq {exits[1]} || {{ echo exit code $code; exit 1; }}")
        else:
            lines.append(command)
    return "\n".join(lines)


def carry_out(block, folder, run):
    """Write a block's file, or run its commands; `run` is in_a_shell or in_this_process."""
    if block.file:
        path = folder / block.file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.body, encoding="utf-8")
    else:
        run(block.body, folder)


def in_this_process(body, folder):
    """Call what the commands of a block call; whatever is not plainly `explore-bench` is left to a shell."""
    for command in commands(body):
        told, exits = EXITS.sub("", command), EXITS.search(command)
        if not told.startswith("explore-bench ") or re.search(r"[|&;<>$*`]", told):
            in_a_shell(f"$ {command}\n", folder)
            continue
        with contextlib.chdir(folder), pytest.raises(SystemExit) as ended:
            main(shlex.split(told)[1:])
        assert (ended.value.code or 0) == int(exits[1] if exits else 0), command


def in_a_shell(body, folder):
    """Run the commands of a block as a reader would, with this environment's first on the path."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", script(body)],
        cwd=folder,
        env=os.environ | {"PATH": path, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    assert done.returncode == 0, f"{body}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"


def prepare(folder):
    """Give a folder what the pages take for granted."""
    for name in ("examples", "results/reference"):
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name)
    (folder / ".venv").symlink_to(sys.prefix)


WITH_COMMANDS = [page for page in PAGES if any(not block.file for block in blocks(page.read_text(encoding="utf-8")))]
FAST = [page for page in WITH_COMMANDS if any(not b.slow and not b.file for b in blocks(page.read_text("utf-8")))]


@pytest.mark.parametrize("page", FAST, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_quick_commands_of_a_page_do_what_it_says(page, tmp_path):
    prepare(tmp_path)
    for block in blocks(page.read_text(encoding="utf-8")):
        if not block.slow:
            carry_out(block, tmp_path, in_this_process)


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_COMMANDS, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_all_commands_of_a_page_do_what_it_says(page, tmp_path):
    prepare(tmp_path)
    for block in blocks(page.read_text(encoding="utf-8")):
        carry_out(block, tmp_path, in_a_shell)
    LEFT.get(page.relative_to(ROOT).as_posix(), lambda folder: None)(tmp_path)


def test_the_pages_whose_files_are_looked_at_have_commands():
    assert LEFT.keys() <= {page.relative_to(ROOT).as_posix() for page in WITH_COMMANDS}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_no_command_stands_where_no_test_runs_it(page):
    """One in an indented block, in a block without a tag, or without its dollar sign."""
    text = page.read_text(encoding="utf-8")
    run = {command for block in blocks(text) if not block.file for command in commands(block.body)}
    for line in re.findall(r"^(?: {4,}|\$ )?(?:\.venv/bin/)?explore-bench .*$", text, re.MULTILINE):
        joined = re.sub(r"\\\n", " ", text[text.index(line) :])
        assert joined.splitlines()[0].removeprefix("$ ").strip() in {one.strip() for one in run}, line


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_named_in_a_sentence_exist(page):
    """With the options that stand behind them."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    for inline in re.findall(r"`(?:\.venv/bin/)?explore-bench ([^`]+)`", text):
        name, *rest = shlex.split(re.sub(r"[\[\]|\\]", " ", inline).replace("…", "").replace("...", ""))
        assert name in cli.commands, inline
        options = {
            one for option in cli.commands[name].params for one in option.opts if isinstance(option, click.Option)
        }
        assert {word for word in rest if re.match(r"--?[a-z]", word)} <= options, inline


# The reading of pages


PAGE = """
Text.

```console
$ one --x \\
      2
output
$ two  # exits 3
```

<!-- slow -->
```console
$ three
```

```python
# made.py
x = 1
```

```python
print("only to be read")
```
"""


def test_a_page_is_read_block_by_block():
    found = blocks(PAGE)
    assert [block.slow for block in found] == [False, True, False]
    assert [block.file for block in found] == [None, None, "made.py"]
    assert commands(found[0].body) == ["one --x        2", "two  # exits 3"]


@pytest.mark.parametrize("run", [in_a_shell, in_this_process])
def test_a_block_ends_at_the_first_command_that_fails(tmp_path, run):
    carry_out(Block(False, "$ test -d .\n$ false  # exits 1\n$ touch reached\n"), tmp_path, run)
    assert (tmp_path / "reached").exists()
    with pytest.raises(AssertionError, match="exit code 1"):
        carry_out(Block(False, "$ false  # exits 2\n$ touch other\n"), tmp_path, run)
    with pytest.raises(AssertionError):
        carry_out(Block(False, "$ false\n$ touch other\n"), tmp_path, run)
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize("run", [in_a_shell, in_this_process])
def test_a_command_ends_as_the_page_says_in_its_folder(tmp_path, run):
    wrong = "$ explore-bench run --scenario here.toml smoke"
    carry_out(Block(False, f"{wrong}  # exits 2\n$ test ! -e there && touch there\n"), tmp_path, run)
    assert (tmp_path / "there").exists()
    for otherwise in (f"{wrong}  # exits 1", "$ explore-bench list  # exits 2"):
        with pytest.raises(AssertionError):
            carry_out(Block(False, f"{otherwise}\n$ touch other\n"), tmp_path, run)
    assert not (tmp_path / "other").exists()


def test_a_named_block_is_written(tmp_path):
    carry_out(blocks(PAGE)[2], tmp_path, in_this_process)
    assert (tmp_path / "made.py").read_text(encoding="utf-8") == "# made.py\nx = 1\n"
