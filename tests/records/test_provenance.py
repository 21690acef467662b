"""The key of a trial: what changes it, what does not, and which code and libraries it follows."""

import dataclasses
import itertools
import json
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
import second_kind
from handmade import TINY, tiny_plan, write_plugin

import baselines
import explore_bench
from explore_bench.records import provenance
from explore_bench.records.provenance import (
    code_digest,
    forget_code,
    installed_version,
    library_versions,
    scenario_digest,
    spec_values,
    trial_key,
    weights_digest,
)
from explore_bench.strategies.entry import parse_factory
from explore_bench.trial.spec import TrialSpec
from explore_bench.world.kinds import KINDS
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER

BASE = TrialSpec("nearest", "baselines.nearest:Nearest", TINY, 0)


def changed(**fields):
    return dataclasses.replace(BASE, **fields)


# What a specification contributes


def test_a_key_is_twenty_hexadecimal_digits():
    assert len(trial_key(BASE)) == 20
    int(trial_key(BASE), 16)


@pytest.mark.parametrize(
    "fields",
    [
        {"trial": 1},
        {"root": 1},
        {"purpose": "calibrate"},
        {"parameters": {"weight": 0.5}},
        {"reference": True},
        {"training_seed": 0},
        {"broken": "it cannot be imported"},
        {"scenario": TINY.replace(coverage=0.79)},
        {"scenario": TINY.replace(size=14.0)},
        {"factory": "baselines.random_walk:Random"},
        {"factory": "baselines.nearest:Other"},
    ],
    ids=lambda fields: next(iter(fields)),
)
def test_whatever_defines_a_trial_changes_its_key(fields):
    assert trial_key(changed(**fields)) != trial_key(BASE)


@pytest.mark.parametrize("name", sorted(LandmarkScenario.model_fields.keys() - {"kind"}))
def test_every_constant_of_the_scenario_changes_the_key(name):
    other = {"fusion": "determinant", "first_sight": "replace", "occlusion": True, "cell_size": 1.0, "coverage": 0.7}
    other |= {
        "key_pose_spacing": 0.5,
        "map": ("......",) * 6,
        "landmarks_occupy": True,
        "margin": 2.0,
        "withhold": False,
    }
    other |= {"start_moves": 4, "planner": "straight"}
    value = getattr(TINY, name)
    new = other[name] if name in other else 1 if value is None else 2 * value
    if name in ("hit", "miss", "occupancy_clamp"):
        new = value + 0.01
    if name == "obstacle_density":
        new = value / 2
    base = {"obstacle_count": 0} if name == "planner" else {}  # it goes round nothing
    scenario = TINY.replace(**base)
    assert trial_key(changed(scenario=scenario.replace(**{name: new}))) != trial_key(changed(scenario=scenario))
    if name != "map":
        assert scenario_digest(scenario.replace(**{name: new})) != scenario_digest(scenario)


def test_the_kind_of_world_changes_the_key(monkeypatch):
    second_kind.registered(monkeypatch)
    assert trial_key(changed(scenario=Scenario(kind="chess"))) != trial_key(changed(scenario=Scenario(size=16.0)))


def test_the_name_of_the_scenario_does_not_change_the_key():
    assert trial_key(changed(scenario_name="another name")) == trial_key(BASE)


def test_one_strategy_under_two_names_has_two_keys():
    assert trial_key(changed(strategy="another name")) != trial_key(BASE)


def test_a_constant_set_to_its_default_does_not_change_the_key():
    same = TINY.replace(sensor_range=TINY.sensor_range)
    assert trial_key(changed(scenario=same)) == trial_key(BASE)


def test_parameters_count_in_any_order():
    forth, back = {"a": 1, "b": 2.5}, {"b": 2.5, "a": 1}
    assert trial_key(changed(parameters=forth)) == trial_key(changed(parameters=back))
    assert trial_key(changed(parameters=forth)) != trial_key(changed(parameters={"a": 2.5, "b": 1}))


def test_close_values_have_different_keys():
    assert trial_key(changed(parameters={"w": 0.1 + 0.2})) != trial_key(changed(parameters={"w": 0.3}))


def test_the_record_version_changes_the_key(monkeypatch):
    before = trial_key(BASE)
    monkeypatch.setattr(provenance, "SCHEMA_VERSION", provenance.SCHEMA_VERSION + 1)
    assert trial_key(BASE) != before


def test_a_key_is_the_same_in_another_process():
    code = (
        "from explore_bench.trial.spec import TrialSpec\n"
        "from explore_bench.world.scenario import Scenario\n"
        "from explore_bench.records.provenance import trial_key\n"
        f"print(trial_key(TrialSpec('nearest', 'baselines.nearest:Nearest', Scenario(**{TINY.model_dump()!r}), 0)))"
    )
    environment = {"PYTHONHASHSEED": "1", "PATH": ""}
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert found.stdout.strip() == trial_key(BASE)


def test_a_specification_survives_json():
    spec = changed(parameters={"w": 1 / 3, "deep": {"a": [1, 2]}}, training_seed=4, reference=True, weights="a/b.c")
    values = json.loads(json.dumps(spec_values(spec)))
    assert TrialSpec(**{**values, "scenario": Scenario(**values["scenario"])}) == spec


# Weights


@pytest.fixture
def weighed(tmp_path, fresh_digests):
    """Return a function that writes a file of weights and returns the key of a trial with them."""

    def write(content, place="a/weights-0.safetensors"):
        file = tmp_path / place
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
        fresh_digests()
        return trial_key(changed(weights=str(file)))

    return write


def test_the_bytes_of_the_weights_change_the_key(weighed):
    keys = [weighed(content) for content in (b"one", b"two", b"one ", b"", b"one")]
    assert keys[0] == keys[-1]
    assert len(set(keys)) == 4
    assert trial_key(BASE) not in keys


def test_the_weights_may_lie_anywhere(weighed):
    """Neither their folder nor their name is part of the key, so that records can be compared between machines."""
    assert weighed(b"one") == weighed(b"one", "b/weights-0.safetensors") == weighed(b"one", "other.safetensors")


def test_weights_that_are_gone_have_a_key_of_their_own(weighed, tmp_path, fresh_digests):
    before = weighed(b"one", "gone.safetensors")
    (tmp_path / "gone.safetensors").unlink()
    fresh_digests()
    after = trial_key(changed(weights=str(tmp_path / "gone.safetensors")))
    assert after not in (before, trial_key(BASE))
    assert weights_digest(str(tmp_path / "gone.safetensors")) == "absent"


def test_the_training_seed_counts_beside_the_weights(weighed, tmp_path):
    """Two trainings may end alike, and their rows are two all the same."""
    weighed(b"one")
    spec = changed(weights=str(tmp_path / "a" / "weights-0.safetensors"), training_seed=0)
    assert trial_key(spec) != trial_key(dataclasses.replace(spec, training_seed=1))


def test_weights_that_were_trained_anew_are_seen_once_the_code_is_read_anew(weighed, tmp_path):
    before = weighed(b"one")
    file = tmp_path / "a" / "weights-0.safetensors"
    file.write_bytes(b"two")
    spec = changed(weights=str(file))
    assert trial_key(spec) == before, "within a run they do not change"
    forget_code()
    assert trial_key(spec) != before


# The digest of a scenario


def test_a_scenario_s_digest_is_twelve_hexadecimal_digits_of_its_constants():
    digest = scenario_digest(TINY)
    assert len(digest) == 12
    int(digest, 16)
    assert scenario_digest(TINY.replace(sensor_range=TINY.sensor_range)) == digest
    card = json.loads((Path(baselines.__file__).parent / "weights" / "graph-stnn-0.json").read_text())
    assert scenario_digest(PAPER) == card["scenario_digest"], "what weights were trained on is still said by its digest"
    others = {scenario_digest(TINY.replace(**{name: 2 * getattr(TINY, name)})) for name in ("size", "odometry_sigma")}
    assert len(others | {digest}) == 3


# The source of a strategy


def key_of(factory):
    return trial_key(dataclasses.replace(tiny_plan([factory], trials=1)[0]))


EDITS = {
    "a comment": ("import math", "import math  # why?\n\n# a comment"),
    "a docstring of the class": ("class Plugin:", 'class Plugin:\n    """Another plugin."""\n'),
    "a docstring of a function": ("def later(self, o):", 'def later(self, o):\n        """Later."""'),
    "a docstring of the module": ('"""A plugin."""', '"""Quite another\n\nplugin."""'),
    "blank lines and parentheses": ("return 0", "\n\n        return (0)"),
}
SOURCE = '''"""A plugin."""
import math

class Plugin:
    def later(self, o):
        return 0
    def reset(self, rng): ...
'''


@pytest.fixture
def plugin(tmp_path):
    """Return a function that writes a strategy's file, each time in a folder of its own, and returns a trial's key."""
    folders = (tmp_path / f"{i}" for i in itertools.count())

    def write(source):
        folder = next(folders)
        folder.mkdir()
        (folder / "plugin.py").write_text(source)
        return key_of(f"{folder / 'plugin.py'}:Plugin")

    return write


@pytest.mark.parametrize("edit", EDITS)
def test_what_does_not_run_does_not_change_the_key(plugin, edit):
    old, new = EDITS[edit]
    assert old in SOURCE
    assert plugin(SOURCE.replace(old, new)) == plugin(SOURCE)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("return 0", "return 1"),
        ("return 0", "return -0"),
        ("self, o", "self, o=None"),
        ("import math\n", "import os\n"),
    ],
)
def test_code_that_changes_changes_the_key(plugin, old, new):
    assert plugin(SOURCE.replace(old, new)) != plugin(SOURCE)


def test_a_string_that_is_no_docstring_counts(plugin):
    assert plugin(SOURCE.replace("return 0", "return 'a'")) != plugin(SOURCE.replace("return 0", "return 'b'"))


def test_a_plugin_s_file_may_lie_anywhere(tmp_path):
    """Its folder is no part of the key, so that records can be compared between machines."""
    keys = set()
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.mkdir()
        keys.add(key_of(write_plugin(folder)))
    assert len(keys) == 1


@pytest.fixture
def package(tmp_path, monkeypatch, fresh_digests):
    """Return a function that writes modules of a package and returns the digest of one."""

    def write(place, **sources):
        folder = tmp_path / "someones_package"
        folder.mkdir(exist_ok=True)
        for name in ("__init__", *sources):
            (folder / f"{name}.py").write_text(sources.get(name, ""))
        fresh_digests()
        return code_digest(f"someones_package.{place}", "landmark")

    monkeypatch.syspath_prepend(tmp_path)
    yield write
    for name in [name for name in sys.modules if name.startswith("someones_package")]:
        del sys.modules[name]


@pytest.mark.parametrize(
    "statement",
    [
        "from someones_package.maths import f",
        "import someones_package.maths",
        "from .maths import f",
        "from . import maths",
        "from someones_package import maths",
        "def late():\n    from .maths import f",
    ],
)
def test_a_module_of_the_strategy_s_own_package_counts_however_it_is_imported(package, statement):
    before = package("strategy", strategy=statement, maths="def f(): return 1")
    assert package("strategy", strategy=statement, maths="def f(): return 2") != before
    assert package("strategy", strategy=statement, maths="def f(): return 1  # the same") == before


def test_a_package_outside_of_the_libraries_counts_for_a_file_that_imports_it(package, tmp_path, fresh_digests):
    """In a checkout, say, or installed from one to be edited."""
    plugin = write_plugin(tmp_path, head="from someones_package.maths import f")
    keys = []
    for source in ("f = 1", "f = 2", "f = 1  # the same"):
        package("strategy", maths=source)
        keys.append(key_of(plugin))
    assert keys[0] == keys[2] != keys[1]


def test_a_file_beside_the_plugin_counts_where_it_can_be_imported(tmp_path, monkeypatch, fresh_digests):
    plugin, beside = write_plugin(tmp_path, head="import beside_the_plugin"), tmp_path / "beside_the_plugin.py"
    beside.write_text("f = 1\n")
    assert "beside_the_plugin" not in modules(plugin)
    monkeypatch.syspath_prepend(tmp_path)
    fresh_digests()
    before = key_of(plugin)
    beside.write_text("f = 2\n")
    fresh_digests()
    assert key_of(plugin) != before


def test_packages_that_register_strategies_count_by_source_wherever_they_lie(tmp_path):
    followed = modules(write_plugin(tmp_path, head="from baselines.nearest import Nearest"))
    assert "baselines.nearest" in followed
    assert provenance._counts_by_source("baselines")
    assert not provenance._counts_by_source("pytest")
    assert not provenance._counts_by_source("no_such_package_anywhere")
    assert not provenance._counts_by_source("json")


def test_an_installed_package_counts_by_source_for_its_own_strategy_alone(tmp_path, monkeypatch, fresh_digests):
    library = tmp_path / "site-packages" / "someones_library"
    library.mkdir(parents=True)
    (library / "__init__.py").write_text("")
    (library / "strategy.py").write_text("from .maths import f\n")
    (library / "maths.py").write_text("f = 1\n")
    monkeypatch.syspath_prepend(library.parent)
    fresh_digests()
    assert "someones_library.maths" in modules("someones_library.strategy:Mine")
    assert "someones_library.maths" not in modules(write_plugin(tmp_path, head="import someones_library.maths"))


def test_a_module_imported_by_an_imported_one_counts(package):
    chain = {"strategy": "from .a import f", "a": "from .b import f"}
    assert package("strategy", **chain, b="f = 1") != package("strategy", **chain, b="f = 2")


def test_a_module_of_the_package_that_nothing_imports_does_not_count(package):
    assert package("strategy", strategy="x = 1", other="f = 1") == package("strategy", strategy="x = 1", other="f = 2")


# Which modules are followed


def modules(factory):
    return set(provenance._modules(parse_factory(factory)[0], "landmark"))


ALL_OF = ("robot", "robot.landmark", "robot.planning", "world.landmark", "trial.landmark")
"""Packages of which a trial in a landmark world runs every module."""

SOME = {"trial.run", "trial.loop", "trial.explorer", "trial.steps", "trial.seeding", "geometry", "world.scenario"}


def sources(folder):
    package = Path(explore_bench.__file__).parent.joinpath(*folder.split("."))
    return {f"explore_bench.{folder}.{path.stem}" for path in package.glob("[a-z]*.py")}


@pytest.mark.parametrize("factory", ["baselines.nearest:Nearest", "baselines.reference.clairvoyant:Clairvoyant"])
def test_all_of_the_core_that_a_trial_runs_is_followed(factory):
    followed = modules(factory)
    assert followed >= {f"explore_bench.{name}" for name in SOME}
    for folder in ALL_OF:
        assert len(sources(folder)) >= 2 or folder == "trial.landmark"
        assert followed >= sources(folder)
    assert factory.split(":")[0] in followed


@pytest.mark.parametrize("module", ["gcn", "graph_stnn", "belief_attention"])
def test_a_learned_strategy_is_followed_into_its_network_and_not_into_its_training(module):
    """How weights came about does not matter to a trial: they are part of its key themselves."""
    followed = modules(f"baselines.learned.{module}:strategy")
    assert {f"baselines.learned.{name}" for name in (module, "policy", "checkpoint")} <= followed
    assert not [name for name in followed if name.startswith("baselines.training")]
    assert {"explore_bench.trial.reward", "explore_bench.trial.error_and_efficiency"}.isdisjoint(followed)
    assert "torch" in library_versions(f"baselines.learned.{module}", "landmark")


def test_one_learned_strategy_does_not_depend_on_the_networks_of_another():
    assert "baselines.learned.graph_stnn" not in modules("baselines.learned.gcn:strategy")
    assert "baselines.learned.gcn" not in modules("baselines.learned.graph_stnn:strategy")


HOME = "explore_bench.trial.error_and_efficiency"
"""Module of a public name that no trial needs."""


@pytest.mark.parametrize(
    "head",
    [
        "from explore_bench import score",
        "from explore_bench import score as value",
        "import explore_bench\nwhere = explore_bench.score",
        "import explore_bench as bench\nwhere = bench.score",
        "import explore_bench.geometry\nwhere = explore_bench.score",
        "import explore_bench as bench\nwhere = getattr(bench, 'sc' + 'ore')",
        "from explore_bench import *",
        "from explore_bench.trial.error_and_efficiency import score",
        "import explore_bench.trial.error_and_efficiency",
    ],
)
def test_a_plugin_s_file_is_followed_into_the_core_through_the_public_names(tmp_path, head):
    followed = modules(write_plugin(tmp_path, head=head))
    assert HOME in followed
    assert "plugin.py" in followed


@pytest.mark.parametrize(
    "head", ["from explore_bench import Observation", "import explore_bench", "import explore_bench as b\nb.Target"]
)
def test_a_plugin_s_file_is_not_followed_to_public_names_that_it_does_not_take(tmp_path, head):
    assert HOME not in modules(write_plugin(tmp_path, head=head))


@pytest.mark.parametrize("factory", ["baselines.nearest:Nearest", "baselines.uncertainty:Uncertainty"])
def test_what_only_keeps_and_shows_results_is_not_followed(factory):
    parts = {"records", "analysis", "runs", "report", "cli", "gymnasium"}
    followed = modules(factory)
    assert not [name for name in followed if name.split(".")[1] in parts and name.startswith("explore_bench")]
    assert "explore_bench.strategies.registry" not in followed


# Which edit makes which trials stale, in a copy of the package


KEYS = """
import json, sys
from pathlib import Path

import explore_bench
from explore_bench.records import provenance
from explore_bench.records.provenance import trial_key
from explore_bench.trial.spec import TrialSpec
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER

root = Path(sys.argv[1])
assert Path(explore_bench.__file__).is_relative_to(root)
STRATEGIES = {
    "nearest": "baselines.nearest:Nearest",
    "clairvoyant": "baselines.reference.clairvoyant:Clairvoyant",
    "public": f"{root / 'public.py'}:Plugin",
}

def keys():
    for of_code in ("code_digest", "_modules"):
        getattr(provenance, of_code).cache_clear()  # and what is known of the libraries stays
    return {
        f"{kind} {name}": trial_key(TrialSpec(name, factory, Scenario(kind=kind), 0))
        for kind in ("landmark", "chess")
        for name, factory in STRATEGIES.items()
    }

found = {}
before = keys()
for file in sys.argv[2:]:
    path = root / file
    source = path.read_text()
    path.write_text(source + "\\nEDITED = 1\\n")
    after = keys()
    path.write_text(source)
    found[file] = sorted(name for name in before if after[name] != before[name])
assert keys() == before
print(json.dumps(found))
"""

LANDMARK = ["landmark clairvoyant", "landmark nearest", "landmark public"]
CHESS = ["chess clairvoyant", "chess nearest", "chess public"]
STALE = {
    # of one kind
    "explore_bench/robot/landmark/smoother.py": LANDMARK,
    "explore_bench/robot/landmark/graph.py": ["chess clairvoyant", *LANDMARK],  # which expects landmarks
    "explore_bench/trial/landmark/explorer.py": LANDMARK,
    "explore_bench/trial/landmark/step.py": LANDMARK,
    "explore_bench/world/landmark/motion.py": LANDMARK,
    "second_kind.py": CHESS,
    # of all
    "explore_bench/robot/planning/shortest_paths.py": CHESS + LANDMARK,
    "explore_bench/trial/loop.py": CHESS + LANDMARK,
    "explore_bench/trial/run.py": CHESS + LANDMARK,
    "explore_bench/world/scenario.py": CHESS + LANDMARK,
    # of one strategy
    "explore_bench/trial/error_and_efficiency.py": [
        *("chess clairvoyant", "chess public"),
        *("landmark clairvoyant", "landmark public"),
    ],
    "baselines/reference/clairvoyant.py": ["chess clairvoyant", "landmark clairvoyant"],
    "public.py": ["chess public", "landmark public"],
    # of none
    "explore_bench/__init__.py": [],
    "explore_bench/trial/__init__.py": [],
    "explore_bench/trial/reward.py": [],
    "explore_bench/analysis/metrics.py": [],
    "explore_bench/records/store.py": [],
    "explore_bench/report/tables.py": [],
    "explore_bench/robot/entirely_new.py": [],
}


def test_an_edit_makes_exactly_those_trials_stale_that_run_it(tmp_path):
    """A function that only the public list leads to, each kind's explorer, the loop: nothing drops out of a key."""
    for package in (explore_bench, baselines):
        folder = Path(package.__file__).parent
        shutil.copytree(folder, tmp_path / folder.name, ignore=shutil.ignore_patterns("__pycache__", "weights"))
    shutil.copy(second_kind.__file__, tmp_path)
    (tmp_path / "explore_bench" / "robot" / "entirely_new.py").write_text("")
    (tmp_path / "public.py").write_text(f"from explore_bench import score\n{SOURCE}")
    kinds = tmp_path / "explore_bench" / "world" / "kinds.py"
    parts = ", ".join(f"{name}={value!r}" for name, value in vars(second_kind.CHESS).items())
    kinds.write_text(kinds.read_text() + f'\nKINDS["chess"] = Kind({parts})\n')
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-c", KEYS, str(tmp_path), *STALE]
    found = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, check=False)
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout) == STALE


def test_what_a_kind_says_of_records_is_no_part_of_its_trials():
    """Its metrics and tables can change without a new simulation."""
    followed = provenance._modules("baselines.nearest", "lidar").keys()
    assert {"explore_bench.trial.lidar.explorer", "explore_bench.world.lidar.world"} <= followed
    assert KINDS["lidar"].metrics.startswith("explore_bench.analysis.lidar")
    assert not [name for name in followed if name.startswith(("explore_bench.analysis", "explore_bench.report"))]


# Libraries


def test_libraries_that_the_trial_s_code_imports_enter_with_their_versions():
    versions = library_versions("baselines.nearest", "landmark")
    assert {"gtsam", "numba", "numpy"} <= versions.keys()
    assert "torch" not in versions
    assert versions["numpy"] == installed_version("numpy")


def test_a_strategy_that_imports_torch_depends_on_its_version(tmp_path):
    factory = write_plugin(tmp_path, head="import torch")
    assert library_versions(parse_factory(factory)[0], "landmark")["torch"] == installed_version("torch")


def test_every_library_that_a_plugin_imports_enters_with_its_version(tmp_path):
    factory = write_plugin(tmp_path, head="import json, pytest, yaml_is_no_module\nfrom PIL import Image")
    versions = library_versions(parse_factory(factory)[0], "landmark")
    assert versions["pytest"] == installed_version("pytest")
    assert versions["PIL"] == installed_version("pillow") != "absent"
    assert versions["yaml_is_no_module"] == "absent"
    assert "json" not in versions
    assert "pydantic" not in versions, "what the core imports beyond its LIBRARIES changes no number"


def test_installing_what_a_plugin_lacked_changes_its_key(tmp_path, monkeypatch, fresh_digests):
    plugin = write_plugin(tmp_path, head="import lacking_so_far")
    before = key_of(plugin)
    folder = tmp_path / "site-packages"
    folder.mkdir()
    (folder / "lacking_so_far.py").write_text("")
    monkeypatch.syspath_prepend(folder)
    fresh_digests()
    assert key_of(plugin) != before


def test_another_version_of_a_library_changes_the_key(monkeypatch, fresh_digests):
    before = trial_key(BASE)
    monkeypatch.setattr(provenance, "version", lambda name: "99.0" if name == "gtsam" else "1.0")
    library_versions.cache_clear()
    assert library_versions("baselines.nearest", "landmark")["gtsam"] == "99.0"
    assert trial_key(BASE) != before


def test_a_library_that_is_not_installed_is_absent():
    assert installed_version("no-such-distribution-anywhere") == "absent"


LAYOUTS = {
    "the strategy's own module": ("learner:Plugin", {"learner.py": "import torch\n"}),
    "a module of its package": (
        "learning.policy:Plugin",
        {
            "learning/__init__.py": "",
            "learning/policy.py": "from .net import Net\n",
            "learning/net.py": "import torch\n",
        },
    ),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_reading_versions_and_making_a_key_imports_no_torch(tmp_path, layout):
    """A torch that ends the process when it is imported stands in its place."""
    factory, files = LAYOUTS[layout]
    (tmp_path / "torch.py").write_text("raise SystemExit('torch was imported')\n")
    for name, source in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(source)
    code = f"""
    from explore_bench.records.provenance import library_versions, trial_key
    from explore_bench.world.scenarios import PAPER
    from explore_bench.trial.spec import TrialSpec
    assert "torch" in library_versions("{factory.split(":")[0]}", "landmark")
    trial_key(TrialSpec("learner", "{factory}", PAPER, 0))
    """
    found = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert found.returncode == 0, found.stderr
