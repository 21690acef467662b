"""README.md answers first: a moving picture, what it is, one command, who explores best, in the results' numbers."""

import re
from pathlib import Path

import pytest
from PIL import Image

from explore_bench.analysis.csv_files import read_csv
from explore_bench.strategies.registry import strategies

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MEGABYTE = 10**6


def test_the_answer_stands_before_everything_else():
    """In the order in which a reader asks."""
    asked = (
        "# explore-bench\n",
        "![Three strategies explore the same world",
        "A benchmark of robot exploration:",
        "\n```\nmake bench\n```\n",
        "## Who explores best\n",
        "docs/images/ranking.svg",
        "<!-- begin ranking -->",
        "## What else there is\n",
        "## What makes it a benchmark\n",
        "## Compare your own strategy\n",
    )
    places = [README.index(text) for text in asked]
    assert places == sorted(places)
    assert places[0] == 0
    assert README[: places[4]].count("\n\n") < 12, "nothing else stands above the answer"


def test_the_moving_picture_moves_and_is_small():
    [name] = re.findall(r"!\[[^\]]*\]\(([^)]+\.gif)\)", README)
    assert (ROOT / name).stat().st_size < 3 * MEGABYTE
    with Image.open(ROOT / name) as image:
        assert image.n_frames > 30
        assert image.size[0] <= 1000


def test_every_picture_and_page_that_it_names_is_there():
    for name in re.findall(r"\]\(([^)#]+)\)", README):
        assert name.startswith("http") or (ROOT / name).exists(), name


def test_the_long_tables_stand_on_a_page_of_their_own():
    results = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    for part in ("table2", "claims"):
        assert f"<!-- begin {part} -->" in results
        assert f"<!-- begin {part} -->" not in README
    assert "(docs/results.md)" in README


def rows():
    """Return the rows of the small table as cells."""
    table = README.split("<!-- begin ranking -->\n")[1].split("<!-- end")[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]


@pytest.mark.parametrize(("metric", "column"), [("trajectory_error", 1), ("exploration_efficiency", 2)])
def test_the_small_table_has_the_means_and_intervals_of_the_summary(metric, column):
    summary = read_csv(ROOT / "results" / "summary.csv", ("table", "strategy", "size", "metric", "mean"))
    own = summary[(summary["table"] == "table2") & (summary["size"] == 40.0) & (summary["metric"] == metric)]
    lines = {strategies()[line.strategy].label: line for line in own.itertuples()}
    competitors = {label for label in lines if not label.startswith("Clairvoyant")}
    assert {row[0] for row in rows()} == competitors
    for row in rows():
        line = lines[row[0]]
        assert row[column] == f"{line.mean:.3f} [{line.ci_low:.3f}, {line.ci_high:.3f}]"


def test_the_best_stands_first_in_the_words_the_table_and_the_picture():
    first = rows()[0][0]
    words = README.split("<!-- begin ranking-words -->\n")[1]
    picture = (ROOT / "docs" / "images" / "ranking.svg").read_text(encoding="utf-8")
    assert words.startswith(f"**{first} ")
    assert f"Ranking, best first: {first}, " in picture
    assert "map of 20 m" in picture
    assert "map of 40 m" in picture
