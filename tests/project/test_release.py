"""What a release says of itself is the same everywhere, and its wheel runs outside of the checkout with all weights."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from numba.core.caching import _CacheLocator

from explore_bench.compiled import cache_folder
from explore_bench.files import parse_yaml

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_the_version_stands_in_pyproject_and_what_repeats_it_agrees():
    version = PROJECT["version"]
    citation = parse_yaml((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == version
    assert re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)[1] == version
    for package in ("explore_bench", "baselines"):
        texts = (path.read_text(encoding="utf-8") for path in (ROOT / package).rglob("*.py"))
        assert not [text for text in texts if re.search(rf"""["']{re.escape(version)}["']""", text)]


def test_the_citation_is_of_this_project_and_of_the_paper_that_it_implements():
    citation = parse_yaml((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert citation["title"].startswith(PROJECT["name"])
    assert citation["license"] == PROJECT["license"]
    [paper] = citation["references"]
    assert f"[paper]: https://doi.org/{paper['doi']}\n" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert [author["family-names"] for author in paper["authors"]] == ["Zhang", "Shi", "Zhu", "Zeng", "Zhang"]


def test_the_pythons_that_are_named_are_those_that_are_allowed():
    named = [line.rpartition(" :: ")[2] for line in PROJECT["classifiers"] if "Python :: 3." in line]
    assert PROJECT["requires-python"] == f">={named[0]}"


def take_compiled(installed, folder):
    """Copy what is compiled of the checkout to where it is looked for beside an installed copy: minutes of compiling.

    numba names it by the folder of the source and takes it where the source has the same digest.
    """
    name_of = _CacheLocator.get_suitable_cache_subpath
    for place in {file.parent for name in ("explore_bench", "baselines") for file in (ROOT / name).rglob("*.py")}:
        compiled = cache_folder() / name_of(str(place / "module.py"))
        if compiled.is_dir():
            shutil.copytree(compiled, folder / name_of(str(installed / place.relative_to(ROOT) / "module.py")))


@pytest.mark.slow
def test_a_wheel_holds_all_weights_and_maps_and_runs_outside_of_the_checkout(tmp_path):
    source = tmp_path / "source"
    for name in ("explore_bench", "baselines"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]

    def call(*command, **variables):
        environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | variables
        found = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert found.returncode == 0, found.stdout + found.stderr
        return found.stdout

    call(*pip, "wheel", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", "wheels", source)
    [wheel] = (tmp_path / "wheels").iterdir()
    assert wheel.name == f"explore_bench-{PROJECT['version']}-py3-none-any.whl"
    files = {path for name in ("explore_bench", "baselines") for path in source.joinpath(name).rglob("*")}
    shipped = {path.relative_to(source).as_posix() for path in files if path.is_file()}
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert shipped == held
    assert sum(name.endswith(".safetensors") for name in held) > 50
    call(*pip, "install", "--no-deps", "--no-index", "--target", "installed", wheel)
    shutil.rmtree(source)
    take_compiled(tmp_path / "installed", tmp_path / "compiled")
    own = {"PYTHONPATH": str(tmp_path / "installed"), "NUMBA_CACHE_DIR": str(tmp_path / "compiled")}
    where = "import explore_bench, baselines; print(explore_bench.__file__, baselines.__file__)"
    assert call(sys.executable, "-P", "-c", where, **own).count(f"{tmp_path}/installed/") == 2
    run = [sys.executable, "-P", "-m", "explore_bench"]
    assert call(*run, "--version", **own).strip().endswith(PROJECT["version"])
    asked = ("run", "smoke", "-s", "gcn-obs", "-s", "clairvoyant", "--trials", "1", "--backend", "sequential")
    assert "0 of those asked for failed" in call(*run, *asked, **own)
