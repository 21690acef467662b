"""A submission is whole, the same each time, and refused in a sentence where it is not what it says of itself."""

import hashlib
import io
import json
import shutil
import stat
import zipfile
from pathlib import Path

import pytest
from handmade import write_plugin

from explore_bench.cli import main
from explore_bench.errors import RequestError
from explore_bench.records.encoding import renamed
from explore_bench.records.provenance import trial_key
from explore_bench.records.store import Store
from explore_bench.runs.runner import execute
from explore_bench.runs.submission import archive, manifest
from explore_bench.runs.submission.archive import MANIFEST, read_archive, write_archive
from explore_bench.runs.submission.checking import check_submission
from explore_bench.runs.submission.packing import pack_submission
from explore_bench.runs.suites import SUITES, Suite, plan

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module", autouse=True)
def _small_suite():
    """A suite that is run in no time, under a name that there is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SUITES, "smoke", Suite("small", (("table2", (12.0,)),), trials=2))
        yield


def run(results, strategy, trials=None):
    specs = plan("smoke", [strategy], trials=trials).specs
    store = Store(results)
    store.open(0, "evaluate", specs[0].scenario)
    assert [outcome.status.value for outcome in execute(specs, store, 1, "sequential")] == ["explored"] * len(specs)
    return results


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    """Return folder, plugin, and the bytes of a submission."""
    folder = tmp_path_factory.mktemp("packed")
    plugin = write_plugin(folder)
    run(folder / "results", plugin)
    return folder, plugin, pack_submission("smoke", plugin, folder / "results")[1]


@pytest.fixture
def file(packed, tmp_path):
    path = tmp_path / "a.zip"
    path.write_bytes(packed[2])
    return path


@pytest.fixture
def call(capsys):
    """Return a function that calls `submit` and returns its exit code, its output and its complaint."""

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main(["submit", *map(str, arguments)])
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return run


def changed(file, change):
    """Write the archive anew with its files changed by a function; submission.json is given as values."""
    files = read_archive(file)
    values = json.loads(files.pop(MANIFEST))
    values = change(values, files) or values
    file.write_bytes(write_archive(files | {MANIFEST: json.dumps(values).encode()}))


# What is packed


def test_it_holds_what_its_schema_says_and_is_the_same_wherever_its_files_lie(packed, tmp_path):
    folder, plugin, content = packed
    shutil.copytree(folder / "results", tmp_path / "results")
    moved = shutil.copy(plugin.removesuffix(":Plugin"), tmp_path / "plugin.py")
    about, again = pack_submission("smoke", f"{moved}:Plugin", tmp_path / "results")
    assert again == content
    assert (about.suite, about.strategy, about.factory) == ("smoke", "Plugin", "source/plugin.py:Plugin")
    assert (about.trials, about.weights) == (2, ())
    assert about.source == {"source/plugin.py": hashlib.sha256(Path(moved).read_bytes()).hexdigest()}
    with zipfile.ZipFile(io.BytesIO(content)) as found:
        names = found.namelist()
        assert json.loads(found.read(MANIFEST)) == about.model_dump(mode="json")
    assert names == sorted(names)
    assert [name.split("/")[0] for name in names] == ["source", MANIFEST, "trials", "trials"]
    assert str(folder).encode() not in content, "nothing of the machine"


def test_missing_trials_are_named(packed, tmp_path):
    plugin = write_plugin(tmp_path, name="other")
    run(tmp_path / "results", plugin, trials=1)
    with pytest.raises(RequestError, match=r"lacks 1 of the 2 trials of 'Plugin' in suite.* 12 m, paper, world 1;"):
        pack_submission("smoke", plugin, tmp_path / "results")
    write_plugin(tmp_path, "return 0", name="other")
    from explore_bench.records.provenance import forget_code

    forget_code()
    with pytest.raises(RequestError, match=r"lacks 2 of the 2 trials .* by the present code"):
        pack_submission("smoke", plugin, tmp_path / "results")


def test_weights_are_packed_with_their_digest_and_a_sample_of_them_agrees(tmp_path):
    """Two files of one name, a training seed each."""
    source = (
        "class Weighed:\n"
        "    def __init__(self, weights, k=1):\n"
        "        self.last = open(weights).read() == 'last'\n"
        "    def reset(self, rng): ...\n"
        "    def choose(self, observation):\n"
        "        return int(observation.path_lengths.argmin()) if self.last else 0\n"
    )
    (tmp_path / "weighed.py").write_text(source)
    for seed, text in enumerate(("first", "last")):
        (tmp_path / str(seed)).mkdir()
        (tmp_path / str(seed) / "w.safetensors").write_text(text)
    files = ", ".join(f'"{tmp_path / str(seed) / "w.safetensors"}"' for seed in range(2))
    strategy = f"{tmp_path / 'weighed.py'}:Weighed[weights=[{files}], k=2]"
    run(tmp_path / "results", strategy)
    about, content = pack_submission("smoke", strategy, tmp_path / "results")
    assert about.trials == 4
    assert [(one.seed, one.file) for one in about.weights] == [(n, f"weights/{n}/w.safetensors") for n in range(2)]
    assert about.weights[1].digest == hashlib.sha256(b"last").hexdigest()
    (tmp_path / "a.zip").write_bytes(content)
    shutil.rmtree(tmp_path / "0")
    found = check_submission(tmp_path / "a.zip", sample=4)
    assert found.differs == ()
    assert (found.verified.same, found.verified.different, found.verified.undone) == (4, (), ())


def test_too_much_is_not_packed(monkeypatch):
    monkeypatch.setattr(archive, "MOST_BYTES", 10)
    with pytest.raises(RequestError, match=r"1 files of .* MiB together, and at most 10,000 of"):
        write_archive({MANIFEST: b"01234567890"})
    monkeypatch.setattr(archive, "MOST_FILES", 1)
    with pytest.raises(RequestError, match="2 files"):
        write_archive({MANIFEST: b"", "source/a.py": b""})
    with pytest.raises(RequestError, match=r"'source/a b\.py' is no name"):
        write_archive({"source/a b.py": b""})


def test_the_schema_is_that_of_the_code():
    """docs/fill.py writes it."""
    assert json.loads((ROOT / "submissions" / "schema.json").read_text(encoding="utf-8")) == manifest.schema()


# What a reviewer is told


def test_a_check_runs_nothing_and_says_code_and_endings(call, file, packed, monkeypatch):
    monkeypatch.setattr("explore_bench.runs.verifying.execute", lambda *_: pytest.fail("something was run"))
    code, out, err = call("--check", file)
    assert (code, err) == (0, "")
    digest = hashlib.sha256(Path(packed[1].removesuffix(":Plugin")).read_bytes()).hexdigest()
    assert f"- source/plugin.py: {digest[:12]}, " in out
    assert "2 trials of Plugin in suite smoke" in out
    assert "whole: 2 explored\nnone of its code was run" in out


def test_a_sample_that_agrees_and_one_that_does_not(call, file, packed, tmp_path):
    code, out, _ = call("--check", file, "--sample", 2, "--workers", 1)
    assert code == 0
    assert "sample: 2 of 2 trials came out as they were submitted" in out
    specs = plan("smoke", [packed[1]]).specs
    one, other = (f"trials/{trial_key(spec)}.parquet" for spec in specs)

    def swap(values, files):
        """The rows of the one world are sent as those of the other."""
        from explore_bench.runs.submission.packing import inside

        (tmp_path / "one.parquet").write_bytes(files[one])
        files[other] = renamed(tmp_path / "one.parquet", inside(specs[1]))

    changed(file, swap)
    code, out, _ = call("--check", file, "--sample", 2, "--workers", 1)
    assert code == 1
    assert "sample: 1 of 2 trials came out as they were submitted" in out
    assert "- 12 m, paper, world 1: its world is" in out


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"code": "0" * 64}, "the code here is "),
        ({"libraries": {"numpy": "0.1"}}, "not 0.1"),
        ({"strategy": "Other", "factory": "no_such_module_anywhere:Other", "source": {}}, "code here is"),
        ({"weights": [{"seed": 0, "file": "baselines:weights/a.safetensors", "digest": "0" * 64}]}, "weights here"),
    ],
    ids=["code", "library", "package", "weights"],
)
def test_of_other_code_nothing_is_said(call, file, change, words):
    def apply(values, files):
        if change.get("source") == {}:
            del files["source/plugin.py"]
        return values | change

    changed(file, apply)
    code, out, _ = call("--check", file, "--sample", 1)
    assert code == 3
    assert "nothing can be said of its trials: " in out
    assert words in out


def test_the_command_writes_the_file_and_says_what_is_in_it(call, packed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = call("smoke", "-s", packed[1], "--results", packed[0] / "results")
    assert (code, err) == (0, "")
    assert out.startswith("Plugin-smoke.zip: 0.")
    assert Path("Plugin-smoke.zip").read_bytes() == packed[2]
    for wrong in ((), ("smoke",), ("-s", "nearest"), ("smoke", "--check", "Plugin-smoke.zip")):
        code, out, err = call(*wrong)
        assert (code, out, err.count("\n")) == (2, "", 1), wrong
    assert call("smoke", "-s", "nearest", "--results", tmp_path / "none")[0] == 2


# Hostile files


def entry(name, content=b"", **about):
    """Return bytes of an archive with a manifest and one entry more."""
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w") as made:
        made.writestr(MANIFEST, "{}")
        info = zipfile.ZipInfo(name)
        for key, value in about.items():
            setattr(info, key, value)
        made.writestr(info, content, about.get("compress_type"))
    return sink.getvalue()


def twice():
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w") as made, pytest.warns(UserWarning):
        for _ in range(2):
            made.writestr(MANIFEST, "{}")
    return sink.getvalue()


def overlapping():
    """Two entries of the directory claim the bytes of one file."""
    content = entry("source/a.py", b"x" * 1000)
    start = content.index(b"PK\x01\x02")
    end = content.rindex(b"PK\x05\x06")
    directory = content[start:end]
    last = directory[directory.rindex(b"PK\x01\x02") :]
    more = b"".join(last.replace(b"source/a.py", b"source/%c.py" % letter) for letter in b"bcde")
    tail = bytearray(content[end:])
    tail[8:12] = (6).to_bytes(2, "little") * 2
    tail[12:16] = (len(directory) + len(more)).to_bytes(4, "little")
    return content[:start] + directory + more + bytes(tail)


HOSTILE = {
    "no archive": (lambda: b"nothing of the kind", "no whole archive"),
    "empty": (lambda: b"", "no whole archive"),
    "cut off": (lambda: entry("source/a.py", b"x" * 1000)[:-100], "no whole archive"),
    "a path out of it": (lambda: entry("../../evil.py"), "'../../evil.py' is no file of a submission"),
    "a path out of a folder": (lambda: entry("source/../../evil.py"), "is no file of a submission"),
    "an absolute path": (lambda: entry("/etc/passwd"), "'/etc/passwd' is no file of a submission"),
    "a folder": (lambda: entry("source/"), "is no file of a submission"),
    "another file": (lambda: entry("trials/readme.md"), "is no file of a submission"),
    "a link": (
        lambda: entry("source/a.py", b"/etc/passwd", external_attr=(stat.S_IFLNK | 0o777) << 16, create_system=3),
        "'source/a.py' is no regular file",
    ),
    "a bomb": (lambda: entry("source/a.py", bytes(50_000_000), compress_type=zipfile.ZIP_DEFLATED), "is compressed"),
    "one name twice": (twice, "is in it twice"),
    "overlapping files": (overlapping, "claim"),
    "no manifest": (lambda: write_archive({"source/a.py": b""}), "it has no submission.json"),
    "an empty manifest": (lambda: entry("source/a.py"), "not of the schema: "),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_file_is_refused_in_a_sentence_and_writes_nothing(call, tmp_path, monkeypatch, kind):
    make, words = HOSTILE[kind]
    (tmp_path / "in").mkdir()
    monkeypatch.chdir(tmp_path / "in")
    Path("a.zip").write_bytes(make())
    code, out, err = call("--check", "a.zip", "--sample", 1)
    assert (code, out, err.count("\n")) == (2, "", 1), err
    assert "submission 'a.zip'" in err
    assert words in err
    assert [path.name for path in tmp_path.rglob("*")] == ["in", "a.zip"]


def test_a_file_that_is_not_there_or_no_file_is_refused(call, tmp_path):
    for path in (tmp_path / "none.zip", tmp_path):
        code, out, err = call("--check", path)
        assert (code, out, err.count("\n")) == (2, "", 1)


INCONSISTENT = {
    "another schema": (lambda values, files: values | {"format": 2}, "not of the schema: format"),
    "a field more": (lambda values, files: values | {"more": 1}, "not of the schema: more"),
    "a field of another type": (lambda values, files: values | {"trials": "all"}, "not of the schema: trials"),
    "no suite": (lambda values, files: values | {"suite": "none"}, "suite 'none' is unknown"),
    "fewer trials": (lambda values, files: files.popitem() and None, "of the 2 trials"),
    "another number": (lambda values, files: values | {"trials": 3}, "of the 2 trials"),
    "a trial more": (lambda values, files: files.update({f"trials/{'0' * 20}.parquet": b""}), "and 1 others"),
    "other source": (lambda values, files: files.update({"source/plugin.py": b"evil"}), "not the file whose digest"),
    "source more": (lambda values, files: files.update({"source/b.py": b"evil"}), "source/b.py is not named"),
    "no source": (lambda values, files: files.pop("source/plugin.py") and None, "it lacks source/plugin.py"),
    "a factory elsewhere": (lambda values, files: values | {"factory": "/etc/x.py:Plugin"}, "is no file of it"),
    "a damaged trial": (lambda values, files: files.update({max(files): b"PAR1"}), "is no record of its trial"),
}


@pytest.mark.parametrize("kind", INCONSISTENT)
def test_a_submission_that_is_not_what_it_says_is_refused_in_a_sentence(call, file, kind):
    change, words = INCONSISTENT[kind]
    changed(file, change)
    code, out, err = call("--check", file, "--sample", 1)
    assert (code, out, err.count("\n")) == (2, "", 1), out + err
    assert words in err


def test_a_trial_of_one_key_under_another_is_refused(call, file):
    def swap(values, files):
        one, other = sorted(name for name in files if name.startswith("trials/"))
        files[one], files[other] = files[other], files[one]

    changed(file, swap)
    code, _, err = call("--check", file)
    assert code == 2
    assert "is no record of its trial" in err
