"""The site of the documentation: in its menu is every page, and what it computes is what is stored.

`make lint` builds it, and fails at a link that leads nowhere.
"""

import re
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pandas as pd
import pytest

from explore_bench.runs.suites import SUITES
from explore_bench.strategies.registry import strategies

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site():
    pytest.importorskip("mkdocs", reason="mkdocs is not installed")
    spec = spec_from_file_location("site_pages", ROOT / "docs" / "site_pages.py")
    module = module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [*sys.path])
        spec.loader.exec_module(module)
    return module


def test_the_menu_has_every_page_of_the_documentation():
    menu = set(re.findall(r": (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE))
    pages = {f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")}
    assert menu == pages | {"api.md", "suites.md", "submissions/README.md"} | {
        f"{name}.md" for name in ("README", "CONTRIBUTING", "CHANGELOG", "AGENTS")
    }


def test_the_site_keeps_the_styles_and_the_scripts_of_its_theme(site, tmp_path):
    """Without them it is a page of huge icons, and builds strictly all the same."""
    from mkdocs.config import load_config
    from mkdocs.structure.files import get_files

    config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(tmp_path))
    found = get_files(config)
    found.add_files_from_theme(config.theme.get_env(), config)
    names = {file.src_uri for file in config.plugins.on_files(found, config=config)}
    for kind in ("stylesheets/main", "stylesheets/palette", "javascripts/bundle"):
        assert any(name.startswith(f"assets/{kind}") for name in names), kind
    assert {"README.md", "api.md", "docs/stage.md"} <= names


def test_what_a_docstring_says_of_an_attribute_is_its_description_and_no_type():
    griffe = pytest.importorskip("griffe", reason="mkdocstrings is not installed")
    extensions = griffe.load_extensions(str(ROOT / "docs" / "docstrings.py"))
    package = griffe.load("explore_bench", search_paths=[str(ROOT)], extensions=extensions, docstring_parser="numpy")
    of = package["strategies.contract.Observation"]
    [attributes] = [part.value for part in of.docstring.parsed if part.kind.value == "attributes"]
    [positions] = [item for item in attributes if item.name == "positions"]
    assert (str(positions.annotation), positions.description) == (
        "Array",
        "centres of the candidates [m], shape (C, 2).",
    )
    [raised] = [part.value for part in package["check"].final_target.docstring.parsed if part.kind.value == "raises"]
    assert all(item.description for item in raised)


@pytest.mark.parametrize("name", SUITES)
def test_the_page_of_a_suite_has_version_observation_metrics_and_scores(site, name):
    page = site._suite(name)
    for title in ("Version", "Observation", "Metrics", "Reference scores"):
        assert page.count(f"\n## {title}\n") == 1
    assert "trajectory_error" in page
    stored = re.search(r"From \[(results/\S+)\]", page)
    assert (stored and (ROOT / stored[1]).is_file()) or f"`explore-bench run {name}" in page


def test_reference_scores_are_those_of_the_summary(site):
    summary = pd.read_csv(ROOT / "results" / "summary.csv").set_index(["table", "strategy", "size", "metric"])
    line = summary.loc[("table2", "nearest", 20.0, "trajectory_error")]
    [row] = [row for row in site._suite("smoke").splitlines() if row.startswith("| `nearest` |")]
    assert f"| {line['mean']:.3f} [{line['ci_low']:.3f}, {line['ci_high']:.3f}] |" in row
    told = re.findall(r"^\| `([\w-]+)` \|", site._suite("table3").split("## Reference scores")[1], re.MULTILINE)
    assert told == [name for name, entry in strategies().items() if SUITES["table3"].sizes_of(entry)]


def test_a_link_out_of_the_documentation_is_followed_to_files_and_folders(site):
    text = "[a](../examples) [b](../examples/learned.py#L1) [c](https://x.org/y) [d](#e) [f](../no.md) [g](../..)"
    assert list(site._linked(text, ROOT / "docs")) == ["examples", "examples/learned.py"]
    assert "- [`learned.py`](learned.py)" in site._folder(ROOT / "examples")
    assert site._folder(ROOT / "examples" / "explore-bench-frontier").startswith("# explore-bench-frontier")
