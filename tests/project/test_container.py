"""What the container is built from, as far as it can be told without building it; and the commands that pages name."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RECIPE = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def instructions():
    joined = re.sub(r"\\\n", " ", RECIPE)
    return [line.split(None, 1) for line in joined.splitlines() if line and not line.startswith("#")]


def test_the_container_runs_the_command_without_the_rights_of_root():
    names = [name for name, _ in instructions()]
    users = [value for name, value in instructions() if name == "USER"]
    assert users == ["bench"]
    assert names.index("USER") < names.index("ENTRYPOINT")
    assert "RUN" not in names[names.index("USER") :], "what is installed is root's"
    assert dict(instructions())["ENTRYPOINT"] == '["explore-bench"]'


def test_the_container_is_made_of_files_that_are_there_and_of_pinned_packages():
    kept = {line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")}
    copied = [word for name, value in instructions() if name == "COPY" for word in value.split()[:-1]]
    assert set(copied) == kept
    assert all((ROOT / name).exists() for name in copied)
    [run] = [value for name, value in instructions() if name == "RUN"]
    assert "pip install" in run
    assert "--constraint constraints.txt ." in run
    assert "://" not in RECIPE, "no address of a registry"


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "AGENTS.md", "docs/architecture.md"])
def test_every_verb_of_make_that_a_page_names_is_there(page):
    verbs = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    named = set(re.findall(r"`make ([\w-]+)`", (ROOT / page).read_text(encoding="utf-8")))
    assert named <= verbs
