"""The page: what stands on it, what is escaped, that it needs nothing else and never changes."""

import dataclasses
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pytest
from handmade import HALLS, TINY, record, with_spec

from explore_bench.analysis.tables import summary_table, trial_table
from explore_bench.records.store import Store
from explore_bench.report import html, origin
from explore_bench.report.captions import caption
from explore_bench.report.completeness import endings_table, gaps
from explore_bench.report.figures import CURVE_FIGURES
from explore_bench.report.html import Content, Section, render_page, script_json
from explore_bench.report.markup import header_groups
from explore_bench.report.origin import commit, origin_tables, processor
from explore_bench.report.pages.training import TRAINING_FIGURES, VALIDATION_FIGURES
from explore_bench.report.render import write_report
from explore_bench.report.tables import PAPER_TABLES, Scope, Table, paper_table, report_tables
from explore_bench.strategies.registry import strategies

HOSTILE = '</script><script>alert("x")</script><b>$\\frac&amp;'


class Page(HTMLParser):
    """What a parser sees: tables as rows of texts by their captions, ids, names of elements, text outside scripts."""

    def __init__(self, text):
        super().__init__()
        self.tables, self.ids, self.elements, self.words, self.attributes = {}, [], [], "", []
        self._caption, self._cell, self._inside = None, None, None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.elements.append(tag)
        self.attributes += attributes
        self.ids += [values["id"]] if "id" in values else []
        if tag in ("script", "style"):
            self._inside = tag
        elif tag == "figcaption":
            self._caption = ""
        elif tag == "table":
            self.tables[self._caption] = []
        elif tag == "tr":
            self.tables[self._caption].append([])
        elif tag in ("td", "th"):
            self._cell = ""

    def handle_endtag(self, tag):
        if tag in ("script", "style"):
            self._inside = None
        elif tag in ("td", "th"):
            self.tables[self._caption][-1].append(self._cell)
            self._cell = None

    def handle_data(self, data):
        if self._inside:
            return
        self.words += data
        if self._cell is not None:
            self._cell += data
        elif self._caption == "":
            self._caption = data


def content_of(records, store=None, **options):
    trials = trial_table(records)
    tables = tuple(report_tables(trials, summary_table(trials)).values())
    return Content(store or Store(Path("nowhere")), records, trials, tables, **options)


@pytest.fixture(scope="module")
def content(stored):
    return content_of(stored.store.records()[0], stored.store)


@pytest.fixture(scope="module")
def text(content):
    return render_page(content)


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


def data_of(text):
    [found] = re.findall(r'<script type="application/json" id="replays">(.*?)</script>', text, re.DOTALL)
    return json.loads(found)


@pytest.fixture
def bare(monkeypatch):
    """Let no replay be read: records made by hand lie in no store."""
    monkeypatch.setattr("explore_bench.report.player.packed", lambda store, record: "")


# Contents


def test_the_page_has_every_table_with_every_cell(content, page):
    for table in (*content.tables, *origin_tables(content.records)):
        rows = page.tables[table.title]
        assert rows[-len(table.rows) :] == [list(row) for row in table.rows]


def test_numbers_are_those_of_the_summary():
    records = [record(trial=i, scenario=SIZE20, uncertainty=[200.0, 50.0 + 7 * i, 20.0 + i]) for i in range(4)]
    summary = summary_table(trial_table(records))
    own = summary[(summary["table"] == "table2") & (summary["n"] > 0)].set_index("metric")
    table = report_tables(trial_table(records), summary)["means"]
    [row] = [row for row in Page(render_bare(records)).tables[table.title] if row[0] == "Nearest"]
    for metric, place in (("trajectory_error", 4), ("exploration_efficiency", 5)):
        line = own.loc[metric]
        mean, low, high = (f"{line[name]:.{2 if line['mean'] >= 10 else 3}f}" for name in ("mean", "ci_low", "ci_high"))
        assert row[place] == f"{mean} [{low}, {high}]"


def test_the_introduction_explains_what_is_compared_and_how_to_read_it(page):
    words = " ".join(page.words.split())
    for term in (
        "Higher is better",
        "Lower is better",
        "How to read an interval",
        "Graph-STNN",
        "Zhang et al.",
        "reference",
    ):
        assert term in words
    assert "3 strategies for exploring an unknown map, compared in 9 simulated trials on 3 worlds" in words


def test_the_page_begins_with_the_answer_the_ranking_the_verdicts_and_the_player(content):
    verdicts = (("i", "Obstacles help: a network sees them.", "not shown", "Of 1 comparisons: 1 not shown."),)
    section = Section("Do the claims hold?", ("All of it.",))
    text = render_page(dataclasses.replace(content, verdicts=verdicts, sections=(section,)))
    asked = ("<h1>", "is shown to be better in", 'class="ranking wide"', ">not shown</b>", "(i) Obstacles help<")
    asked += ('id="play"', ">How to read this</h2>", ">Do the claims hold?</h2>", ">Tables</h2>", ">Figures</h2>")
    places = [text.index(words) for words in asked]
    assert places == sorted(places)


def test_a_page_without_verdicts_has_no_place_for_them(text):
    assert "Claims, and what the trials say" not in text


def test_the_player_begins_with_the_best_beside_what_others_are_measured_by(text):
    data = data_of(text)
    shown = [data["strategies"][data["start"][key]]["label"] for key in "ab"]
    assert set(shown) == {"Random", "Nearest"}, "the reference competes with nobody"
    assert data["start"]["map"] == len(data["maps"]) - 1
    assert re.search(rf"Ranking, best first: {shown[0]}, ", text)


def test_no_id_is_there_twice(page):
    assert len(page.ids) == len(set(page.ids))


def test_nothing_on_the_page_asks_the_network(text):
    outside = re.sub(r' xmlns(:\w+)?="[^"]*"', "", text)
    assert not re.search(r"https?://|@import|url\((?!#)|<link(?! rel=\"icon\" href=\"data:,\")|<img|<iframe", outside)
    assert "default-src 'none'" in text


def test_all_trials_explored_is_said(page, content):
    assert "None: every one of the 9 trials explored its map." in " ".join(page.words.split())


def test_a_section_of_its_own_stands_before_the_tables(content):
    table = Table("Verdicts", ("claim", "verdict"), (("A beats B", "holds"),), "A note.")
    with_claims = dataclasses.replace(content, sections=(Section("Claims", ("One paragraph.", "Two."), (table,)),))
    text = render_page(with_claims)
    assert text.index("<h2>Claims</h2>") < text.index("<h2>Tables</h2>")
    assert Page(text).tables["Verdicts"] == [["claim", "verdict"], ["A beats B", "holds"]]
    assert "<p>One paragraph.</p><p>Two.</p>" in text
    assert '<a href="#section-1">Claims</a>' in text


def test_figures_stand_inline_with_ids_of_their_own(content, tmp_path):
    drawing = '<svg viewBox="0 0 9 9"><g id="a"><use xlink:href="#a"/></g></svg>'
    files = [tmp_path / f"{name}.svg" for name in ("figure-10a", "figure-10b")]
    for file in files:
        file.write_text(drawing)
    text = render_page(dataclasses.replace(content, figures=files))
    page = Page(text)
    assert {"figure-10a-a", "figure-10b-a"} <= set(page.ids)
    assert len(page.ids) == len(set(page.ids))
    assert "Figure 10a" in page.words


def test_every_figure_has_a_caption():
    names = [*TRAINING_FIGURES, *(name + part for name in CURVE_FIGURES for part in "abc"), "figure-06"]
    captions = [caption(name) for name in names]
    assert len(set(captions)) == len(names)
    for name, words in zip(names, captions, strict=True):
        assert words.startswith(f"Figure {name.removeprefix('figure-').lstrip('0')}. ")
    assert caption("other") == "other"
    assert all(caption(name).startswith("Validation of ") for name in VALIDATION_FIGURES)


def test_the_player_offers_every_strategy_that_ran_and_no_other(text):
    data = data_of(text)
    assert [one["label"] for one in data["strategies"]] == ["Random", "Nearest", "Clairvoyant (reference)"]
    assert {one["strategy"] for one in data["trials"]} == {0, 1, 2}
    for i in range(3):
        own = [one for one in data["trials"] if one["strategy"] == i]
        assert {role for one in own for role in one["roles"]} == {"example", "best", "median", "worst"}
        assert all(one["data"] for one in own)


def test_a_replay_s_scores_are_those_of_its_trial(text, content):
    for one in data_of(text)["trials"]:
        name = ("random", "nearest", "clairvoyant")[one["strategy"]]
        own = content.trials[(content.trials["strategy"] == name) & (content.trials["trial"] == one["world"])].iloc[0]
        assert one["T"] == own["steps"]
        assert float(one["eta"].replace("−", "-")) == pytest.approx(own["exploration_efficiency"], abs=0.006)


# Filters


def test_rows_and_columns_say_what_they_speak_of(content, text):
    assert text.count(' data-s="0"') >= 2
    assert ' data-s="0 1" data-z="12"' in text, "a paired difference"
    table2 = paper_table("table2", PAPER_TABLES["table2"], summary_table(content.trials))
    assert 'data-z="40"' in render_page(dataclasses.replace(content, tables=(table2,))), "columns of Table 2"


def test_columns_of_one_size_share_a_heading():
    table = Table("t", ("Method", "n", "e 20 m: paper", "ours"), (("a", "1", "–", "2"),), columns=SCOPES)
    groups = header_groups(table)
    assert [(group.title, group.names) for group in groups] == [
        ("Method", ()),
        ("n", ()),
        ("e 20 m", ("paper", "ours")),
    ]
    assert groups[2].attributes == ' class="edge" data-z="20"'


def test_words_are_aligned_on_the_left_and_numbers_are_not():
    table = Table("t", ("Method", "n", "why"), (("a", "−1.2 [3, 4]", "because"), ("b", "not run", "x" * 50)))
    assert [group.attributes for group in header_groups(table)] == [' class="words"', "", ' class="long"']


# What must not break it


def test_hostile_labels_stay_text(content, monkeypatch):
    known = strategies()
    monkeypatch.setitem(known, "random", dataclasses.replace(known["random"], label=HOSTILE))
    text = render_page(
        dataclasses.replace(content_of(content.records, content.store), sections=(Section(HOSTILE, (HOSTILE,)),))
    )
    page = Page(text)
    assert page.elements.count("script") == 2
    outside = re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    assert outside.count("alert(") == outside.count("&lt;script&gt;alert(") > 0
    assert data_of(text)["strategies"][0]["label"] == HOSTILE
    assert any(row[0] == HOSTILE for row in page.tables[content.tables[0].title])


def test_json_in_a_script_can_neither_end_it_nor_open_a_comment():
    text = script_json({"a": "</script><!-- & \u2028"})
    assert not set("<>&\u2028") & set(text)
    assert json.loads(text) == {"a": "</script><!-- & \u2028"}


def test_a_plugin_of_an_unknown_name_has_rows_and_a_place_in_the_player(content):
    own = [with_spec(r, strategy="who_knows", factory="gone.away:Plugin") for r in content.records[:3]]
    text = render_page(content_of([*content.records, *own], Relay(content)))
    assert data_of(text)["strategies"][-1]["label"] == "who knows"
    assert any(one["strategy"] == 3 for one in data_of(text)["trials"])


def test_trials_that_failed_without_a_step_leave_a_row_and_no_replay(bare):
    failed = record("failed", rows=0, trial=4, reason=f"ValueError: {HOSTILE}")
    text = render_page(content_of([failed]))
    assert "No trial made a step" in text
    assert 'id="replays"' not in text
    [row] = Page(text).tables["1 of 1 trials did not explore their map"][1:]
    assert row == ["Nearest", "12", "4", "–", "failed", "0", "0.0", f"ValueError: {HOSTILE}"]


def test_one_trial_alone_makes_a_page_that_says_there_are_no_intervals(bare):
    text = render_page(content_of([record(uncertainty=[200.0, 50.0])]))
    assert "Each strategy tried one world only, so there are no intervals." in text
    assert "1 strategy for exploring an unknown map, compared in 1 simulated trial on 1 world" in text


def test_where_a_strategy_tried_two_worlds_nobody_says_that_there_are_no_intervals():
    own = [record(trial=i, uncertainty=[200.0, 50.0]) for i in range(2)]
    other = record(strategy="random", uncertainty=[200.0, 50.0])
    assert not [line for line in gaps(trial_table([*own, other])) if "no intervals" in line]


def test_what_was_not_run_or_not_trained_is_said(untrained):
    untrained("gcn-obs")
    absent = {"gcn-obs", "random", "entropy"}
    ran = [name for name, entry in strategies().items() if "table2" in entry.tables and name not in absent]
    found = gaps(trial_table([record(strategy=name, uncertainty=[200.0, 50.0]) for name in ran]))
    [line] = [line for line in found if line.startswith("Not run: ")]
    assert set(re.split(r": |; |\.$", line)) == {"Not run", "Random", "Entropy", ""}
    [line] = [line for line in found if line.startswith("Not trained, hence not run: ")]
    assert "GCN-obs" in re.split(r": |; |\.$", line)


def test_who_runs_a_few_strategies_misses_no_other():
    """In a folder of the first Table 2 is begun, not Table 3; in one of the second neither is."""
    table2 = [name for name, entry in strategies().items() if "table2" in entry.tables]
    few = [record(strategy=name, uncertainty=[200.0, 50.0]) for name in ("nearest", "random", "graph-stnn")]
    assert not [line for line in gaps(trial_table(few)) if line.startswith("Not ")]
    all_ = [record(strategy=name, uncertainty=[200.0, 50.0]) for name in table2]
    assert not [line for line in gaps(trial_table(all_)) if line.startswith("Not ")]


@pytest.mark.parametrize("name", ["stage", "chen2020"])
def test_a_page_of_another_scenario_promises_no_number_of_the_paper(name, bare):
    """Nor does it miss strategies that only the paper's tables ask for."""
    records = [with_spec(record(uncertainty=[200.0, 50.0]), scenario_name=name)]
    words = Page(render_bare(records)).words
    assert "so no number of it stands here" in words
    assert "stands beside ours" not in " ".join(words.split())
    assert not [line for line in gaps(trial_table(records)) if line.startswith("Not ")]
    assert "stands beside ours" in " ".join(Page(render_bare([record(uncertainty=[200.0, 50.0])])).words.split())


def test_unequal_sets_of_worlds_are_said():
    own = [record(trial=i, uncertainty=[200.0, 50.0]) for i in range(3)]
    others = [record(strategy="random", trial=i, uncertainty=[200.0, 50.0]) for i in range(1)]
    assert "Random lacks 2 of 3 worlds of 12 m." in gaps(trial_table([*own, *others]))
    assert not [line for line in gaps(trial_table(own)) if "lacks" in line]


def test_a_size_or_a_training_seed_that_a_strategy_skipped_is_said():
    own = pd.DataFrame(
        [("nearest", None, 20.0), ("nearest", None, 40.0), ("random", None, 20.0)]
        + [("gcn-no-obs", seed, size) for seed, size in ((0, 20.0), (1, 20.0), (2, 20.0), (0, 40.0))],
        columns=["strategy", "training_seed", "size"],
    ).assign(trial=0, scenario="paper")
    own["training_seed"] = own["training_seed"].astype("Int64")
    found = gaps(own)
    assert "Random has no trials of 40 m." in found
    assert "GCN-no_obs has no trials of 40 m of training seeds 1, 2." in found
    assert not [line for line in found if "of 20 m" in line or line.startswith("Nearest")]


def test_the_page_of_a_given_map_speaks_of_that_map():
    mapped = TINY.replace(map=HALLS)
    made = with_spec(record(rows=3, scenario=mapped), scenario_name="halls.txt")
    words = " ".join(Page(render_bare([made])).words.split())
    assert "1 simulated trial in one given map, 'halls.txt', 20 m wide, with 1 draw of start and noise." in words
    assert "All strategies meet the same map with the same starts and the same noise" in words


def test_the_player_says_how_to_watch_any_other_trial(page):
    assert "explore-bench demo STRATEGY --size M --trial WORLD --output trial.html" in page.words


@pytest.mark.parametrize(("stale", "words"), [(1, "1 stored trial was"), (7, "7 stored trials were")])
def test_trials_of_older_code_are_left_out_and_counted(content, stale, words):
    text = render_page(dataclasses.replace(content, stale=stale))
    assert f"{words} run by older code or libraries and not counted" in text
    assert "older code" not in render_page(content)


def test_every_trial_that_did_not_explore_has_a_row_with_its_reason():
    records = [
        record(uncertainty=[200.0, 50.0]),
        with_spec(record("stuck", trial=1, explored=[0.1, 0.5], reason="20 decisions in cell 3"), training_seed=2),
        record("step_limit", trial=2, explored=[0.1, 0.25]),
    ]
    table = endings_table(records)
    assert [row[2:] for row in table.rows] == [
        ("1", "2", "stuck", "1", "50.0", "20 decisions in cell 3"),
        ("2", "–", "step limit", "1", "25.0", "–"),
    ]
    assert table.scopes[0] == Scope(("nearest",), 12.0)
    assert (table.note, len(table.header)) == ("Scenario: paper.", len(table.rows[0]))
    records[1] = with_spec(records[1], scenario_name="stage")
    named = endings_table(records)
    assert named.header[:3] == ("Method", "scenario", "size [m]")
    assert [row[1] for row in named.rows] == ["stage", "paper"]


# Where the numbers come from


def test_versions_machine_seeds_and_digests_are_told(page, content):
    software = dict(page.tables["Software and machine"][1:])
    assert software["Python"].endswith(".".join(map(str, __import__("sys").version_info[:3])))
    assert software["processor"] == processor() != ""
    assert {"numpy", "gtsam", "torch", "commit", "cores"} <= software.keys()
    protocol = dict(page.tables["Protocol"][1:])
    assert protocol["root seed"] == "0"
    assert any(re.search(r"3 worlds, digest [0-9a-f]{12}", value) for value in protocol.values())
    assert all(re.fullmatch("[0-9a-f]{12}", row[2]) for row in page.tables["Strategies"][1:])


def test_a_training_s_command_comes_from_the_card_and_its_absence_is_said(trained):
    weights = trained(0)
    own = with_spec(record(strategy="gcn-obs", uncertainty=[200.0, 50.0]), training_seed=0, weights=weights[0])
    [row] = origin.strategies_table([own]).rows
    assert re.fullmatch("[0-9a-f]{12}", row[3])
    assert row[5] == "not in the card"
    card = Path(weights[0]).with_suffix(".json")
    card.write_text(json.dumps(json.loads(card.read_text()) | {"command": "explore-bench train gcn-obs"}))
    assert origin.strategies_table([own]).rows[0][5] == "explore-bench train gcn-obs"
    card.unlink()
    assert origin.strategies_table([own]).rows[0][4:] == ("–", "no card")


SHA = "0123456789" * 4


@pytest.mark.parametrize(
    ("files", "found"),
    [
        ({".git/HEAD": SHA}, SHA),
        ({".git/HEAD": "ref: refs/heads/main\n", ".git/refs/heads/main": SHA + "\n"}, SHA),
        ({".git/HEAD": "ref: refs/heads/main", ".git/packed-refs": f"# pack\n{SHA} refs/heads/main\n"}, SHA),
        ({".git": "gitdir: elsewhere\n", "elsewhere/HEAD": SHA}, SHA),
        (
            {
                ".git": "gitdir: home/worktrees/w",
                "home/worktrees/w/HEAD": "ref: refs/heads/w",
                "home/worktrees/w/commondir": "../..",
                "home/refs/heads/w": SHA,
            },
            SHA,
        ),
        ({".git/HEAD": "ref: refs/heads/unborn"}, ""),
        ({".git/HEAD": "<b>"}, ""),
        ({}, ""),
    ],
)
def test_the_commit_is_read_from_the_checkout_where_there_is_one(tmp_path, files, found):
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert commit(tmp_path) == found


# Files


def test_a_report_writes_the_page_and_every_file_twice_the_same(own_store):
    tables = own_store.folder / "tables"
    tables.mkdir()
    for earlier in ("claims.md", "field.tex"):
        (tables / earlier).write_text("of other trials")
    first = {file: file.read_bytes() for file in write_report(own_store.folder).files}
    assert {file.name for file in first} >= {"report.html", "summary.csv", "paired.csv", "means.md"}
    assert set(tables.iterdir()) == {file for file in first if file.parent == tables}, "others are of an earlier report"
    assert first == {file: file.read_bytes() for file in write_report(own_store.folder).files}
    assert str(own_store.folder).encode() not in first[own_store.folder / "report.html"]


def test_the_page_s_files_are_part_of_the_package():
    folder = Path(html.__file__).parent / "assets"
    assert {file.name for file in folder.iterdir()} == {"page.html.j2", "page.css", "player.js"}
    project = (Path(html.__file__).parents[2] / "pyproject.toml").read_text()
    assert '"explore_bench.report" = ["assets/*"]' in project


SIZE20 = record(rows=1).spec.scenario.__class__(size=20.0)
SCOPES = (Scope(), Scope(), Scope(size=20.0), Scope(size=20.0))


class Relay:
    """A store that finds a trial under whatever name its strategy goes."""

    def __init__(self, content):
        self.specs = {(r.spec.strategy, r.spec.trial): r.spec for r in content.records}
        self.store = content.store

    def stored(self, spec):
        return self.specs.get((spec.strategy, spec.trial)) or self.specs["clairvoyant", spec.trial]

    def find(self, spec):
        return self.store.find(self.stored(spec))

    def replay(self, spec):
        return self.store.replay(self.stored(spec))


def render_bare(records):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("explore_bench.report.player.packed", lambda store, record: "")
        return render_page(content_of(records))


def test_the_table_of_trials_need_not_be_sorted(content):
    shuffled = content.trials.iloc[::-1]
    assert render_page(dataclasses.replace(content, trials=shuffled)) == render_page(content)
    assert isinstance(shuffled, pd.DataFrame)
