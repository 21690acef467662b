"""What it takes to lose, change or harm something: how often that was tried, and how often it was done.

    python tests/torture.py [--share 0.05] [--only PART] [--seed 0]

In full, `make torture`, it takes an hour or more. It prints a table of what was tried and what was violated, then a
sentence for each violation, and ends with 1 where there is any. What this machine does not allow is "not tried".
"""

from __future__ import annotations

import argparse
import itertools
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import misbehaving
import numpy as np
from handmade import TINY, tiny_plan, write_plugin, write_thresholds

from explore_bench.analysis.csv_files import read_csv
from explore_bench.analysis.gate.thresholds import load_thresholds
from explore_bench.errors import RequestError
from explore_bench.records.encoding import read_record
from explore_bench.records.provenance import trial_key
from explore_bench.records.store import HALF, Store, missing
from explore_bench.runs import runner
from explore_bench.runs.runner import check_runnable, complete
from explore_bench.runs.workers import process
from explore_bench.world.maps import with_map
from explore_bench.world.scenarios import PAPER, STAGE, load_scenario

COMMAND = [sys.executable, "-c", "from explore_bench.cli import main; main()"]
LONG = 120.0
"""Seconds after which a command counts as one that hangs."""

GONE = 15.0
"""Seconds within which the workers of a process that is no more are gone, too."""

SCENARIO = "size = 12.0\nlandmark_count = 1\nobstacle_count = 2\ncoverage = 0.8\n"
RUN = ("run", "smoke", "-s", "nearest", "-s", "random", "--trials", "6", "--workers", "2", "--scenario")
TRAIN = ("train", "belief-attention", "--episodes", "48", "--resume", "--out")


class NotTriedError(Exception):
    """It is not allowed on this machine; says why."""


@dataclass
class Part:
    """A row of the table: what was tried, and what was violated, a sentence each."""

    name: str
    tried: int = 0
    violations: list[str] = field(default_factory=list)
    why_not: str = ""


@dataclass(frozen=True)
class Bench:
    """What all tries start from: a scenario file, and folders that came about undisturbed."""

    home: Path
    scenario: Path
    whole: Path
    trained: Path
    seconds: dict[str, float]


def told(arguments: list[str], limit: float = LONG) -> tuple[int, str]:
    """Exit code and output of a command; it is killed, and its code is 999, where it hangs."""
    with subprocess.Popen(
        [*COMMAND, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    ) as child:
        try:
            output, _ = child.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            return 999, "it hangs"
    return child.returncode, output


def content(folder: Path) -> dict[str, bytes]:
    """All that a results folder says, but the times; what a killed process had half written says nothing."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and not HALF.search(path.name))
    return {str(path.relative_to(folder)): path.read_bytes() for path in files if path.name != "times.csv"}


def differing(found: Path, expected: Path) -> str:
    """First file in which two folders differ, in words; empty where there is none."""
    one, other = content(found), content(expected)
    names = sorted(one.keys() | other.keys())
    return next((f"'{name}' is not what it was undisturbed" for name in names if one.get(name) != other.get(name)), "")


def prepared(home: Path) -> Bench:
    """Run, report and train undisturbed."""
    scenario, whole, trained = home / "tiny.toml", home / "whole", home / "trained"
    scenario.write_text(SCENARIO)
    seconds = {}
    commands = {
        "run": [*RUN, str(scenario), "--results", str(whole)],
        "report": ["report", "--results", str(whole)],
        "train": [*TRAIN, str(trained)],
    }
    for name, command in commands.items():
        begin = time.monotonic()
        code, output = told(command, 600.0)
        assert code == 0, output
        seconds[name] = time.monotonic() - begin
    seconds["merge"] = 2.0
    return Bench(home, scenario, whole, trained, seconds)


# Kills


def processes_below(pid: int) -> list[int]:
    """Numbers of all processes that a process started, and theirs."""
    parents: dict[int, list[int]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents.setdefault(int(fields[1]), []).append(int(path.parent.name))
    found, waiting = [], [pid]
    while waiting:
        own = parents.get(waiting.pop(), [])
        found += own
        waiting += own
    return found


def is_running(pid: int) -> bool:
    """Whether a process is there, and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def killed(bench: Bench, rng: random.Random, what: str, victim: str) -> list[str]:
    """Kill a command at a random moment, look who stays, give the command again, and compare what came of it."""
    found: list[str] = []
    with tempfile.TemporaryDirectory(dir=bench.home) as place:
        folder = Path(place) / "own"
        if what in ("report", "merge"):
            shutil.copytree(bench.whole, Path(place) / "from")
        if what == "report":
            (Path(place) / "from").rename(folder)
            for path in [*folder.glob("*.*"), *folder.glob("tables/*"), *folder.glob("figures/*")]:
                path.unlink()
        expected = bench.trained if what == "train" else bench.whole
        command = {
            "run": [*RUN, str(bench.scenario), "--results", str(folder)],
            "report": ["report", "--results", str(folder)],
            "merge": ["merge", str(Path(place) / "from"), "--results", str(folder)],
            "train": [*TRAIN, str(folder)],
        }[what]
        with subprocess.Popen(
            [*COMMAND, *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        ) as child:
            moment = rng.uniform(0.05, 1.0) * bench.seconds[what]
            time.sleep(moment)
            below = processes_below(child.pid)
            if victim == "a worker" and below:
                _kill(rng.choice(below))
            elif victim != "a worker":
                for pid in [child.pid, *(below if victim == "all" else [])]:
                    _kill(pid)
            try:
                code = child.wait(LONG)
            except subprocess.TimeoutExpired:
                child.kill()
                found.append("the command hangs")
                code = -9
            if victim == "a worker" and code != 0:
                found.append(f"it ended with {code}, although only a worker was killed")
        deadline = time.monotonic() + GONE
        while any(map(is_running, below)) and time.monotonic() < deadline:
            time.sleep(0.2)
        found += ["a worker is left"] if any(map(is_running, below)) else []
        code, output = told(command)
        if code:
            found.append(f"given again it ended with {code}: {output[-200:]}")
        for again in [["report", "--results", str(folder)]] if what in ("run", "merge") else []:
            code, output = told(again)
            found += [f"the report ended with {code}: {output[-200:]}"] if code else []
        if what == "train":
            names = ("belief-attention-0.safetensors",)
            same = all((folder / name).read_bytes() == (expected / name).read_bytes() for name in names)
            found += [] if same else ["the weights are not those of an undisturbed training"]
        elif what := differing(folder, expected):
            found.append(what)
    return [f"{victim} killed {moment:.1f} s into it: {sentence}" for sentence in found]


def _kill(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


# Disks and writers


@contextmanager
def mounted(place: Path, size: int) -> Iterator[Path]:
    """A file system of so many bytes."""
    place.mkdir()
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)], capture_output=True, text=True
    )
    if done.returncode:
        raise NotTriedError(" ".join(done.stderr.split())[:80] or "mount is not allowed")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=False)


def full_disk(bench: Bench, size: int) -> list[str]:
    """Run and report on a disk with too little room, then where there is enough."""
    found = []
    with tempfile.TemporaryDirectory(dir=bench.home) as place:
        roomy = Path(place) / "roomy"
        with mounted(Path(place) / "small", size) as disk:
            folder = disk / "own"
            for command in (
                [*RUN, str(bench.scenario), "--results", str(folder)],
                ["report", "--results", str(folder)],
            ):
                code, output = told(command)
                if "Traceback" in output or code not in (0, 1, 2, 3):
                    found.append(f"'{command[0]}' ended with {code}: {output[-200:]}")
            shutil.copytree(folder, roomy) if folder.exists() else None
        for command in ([*RUN, str(bench.scenario), "--results", str(roomy)], ["report", "--results", str(roomy)]):
            code, output = told(command)
            found += [f"with room '{command[0]}' ended with {code}: {output[-200:]}"] if code else []
        found += filter(None, [differing(roomy, bench.whole)])
    return [f"a disk of {size:,} bytes: {sentence}" for sentence in found]


def read_only(bench: Bench) -> list[str]:
    """Run and report where nothing may be written."""
    found = []
    with tempfile.TemporaryDirectory(dir=bench.home) as place, mounted(Path(place) / "small", 50_000_000) as disk:
        shutil.copytree(bench.whole, disk / "own")
        next((disk / "own" / "runs").glob("*.parquet")).unlink()
        if subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=False).returncode:
            raise NotTriedError("a file system cannot be made read-only")
        for command in (
            [*RUN, str(bench.scenario), "--results", str(disk / "own")],
            ["report", "--results", str(disk / "own")],
        ):
            code, output = told(command)
            if code != 2 or "Traceback" in output or "writ" not in output:
                found.append(f"'{command[0]}' ended with {code}: {output[-200:]}")
    return found


def two_writers(bench: Bench) -> list[str]:
    """Two runs and a report at a time in one folder."""
    found = []
    with tempfile.TemporaryDirectory(dir=bench.home) as place:
        folder = Path(place) / "own"
        command = [*RUN, str(bench.scenario), "--results", str(folder)]
        with ThreadPoolExecutor(2) as pool:
            for code, output in pool.map(told, [command, command]):
                found += [f"ended with {code}: {output[-200:]}"] if code else []
        code, output = told(["report", "--results", str(folder)])
        found += [f"the report ended with {code}: {output[-200:]}"] if code else []
        found += filter(None, [differing(folder, bench.whole)])
    return found


# Files


def samples(bench: Bench, folder: Path) -> dict[str, tuple[bytes, Callable[[Path], object]]]:
    """Good files of every kind that is read, and what reads them."""
    from PIL import Image

    rows = "##########\n#........#\n#..S.....#\n#........#\n##########\n"
    pixels = np.full((20, 20), 254, np.uint8)
    pixels[0] = pixels[-1] = pixels[:, 0] = pixels[:, -1] = 0
    Image.fromarray(pixels).save(folder / "map.png")
    Image.fromarray(pixels).save(folder / "map.pgm")
    np.save(folder / "map.npy", (255 - pixels) / 255)
    ros = "image: map.pgm\nresolution: 0.5\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
    ros += "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    write_thresholds(folder)
    shard = next((bench.whole / "runs").glob("*.parquet"))
    return {
        "own.toml": (SCENARIO.encode(), lambda path: load_scenario(str(path))),
        "map.txt": (rows.encode(), lambda path: with_map(PAPER, path)),
        "map.yaml": (ros.encode(), lambda path: with_map(STAGE, path)),
        "own.png": ((folder / "map.png").read_bytes(), lambda path: with_map(STAGE, path, 0.5)),
        "own.pgm": ((folder / "map.pgm").read_bytes(), lambda path: with_map(STAGE, path, 0.5)),
        "own.npy": ((folder / "map.npy").read_bytes(), lambda path: with_map(STAGE, path, 0.5)),
        "thresholds.toml": ((folder / "thresholds.toml").read_bytes(), load_thresholds),
        "trials.csv": ((bench.whole / "trials.csv").read_bytes(), lambda path: read_csv(path, ("strategy", "size"))),
        shard.name: (shard.read_bytes(), read_record),
    }


TOKENS = (
    b"9" * 5000,
    b"[" * 3000,
    b"{",
    b"a." * 50,
    b"\x00",
    b"\xff\xfe",
    b"nan",
    b"-1e999",
    b"!!python/none x",
    b"*a",
)


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Return a file with one to five wounds."""
    wounded = bytearray(data)
    for _ in range(rng.randint(1, 5)):
        place = rng.randrange(len(wounded) + 1)
        kind = rng.randrange(5)
        if kind == 0 and place < len(wounded):
            wounded[place] ^= 1 << rng.randrange(8)
        elif kind == 1:
            del wounded[place:]
        elif kind == 2:
            del wounded[place : place + rng.randint(1, 40)]
        elif kind == 3:
            wounded[place:place] = rng.choice(TOKENS)
        else:
            wounded[place:place] = wounded[: rng.randint(0, 200)]
    return bytes(wounded)


def fuzzed(bench: Bench, count: int, rng: random.Random) -> Part:
    """Read wounded files of all kinds."""
    part = Part("wounded files")
    with tempfile.TemporaryDirectory(dir=bench.home) as place:
        folder = Path(place)
        kinds = samples(bench, folder)
        for (name, (data, read)), _ in zip(itertools.cycle(kinds.items()), range(count)):
            path = folder / name
            path.write_bytes(wounded := mutated(data, rng))
            begin = time.monotonic()
            try:
                read(path)
                if name.endswith(".parquet") and wounded != data:
                    part.violations.append("a wounded record was taken for whole")
            except RequestError as error:
                if "\n" in str(error) or len(str(error)) > 2000:
                    part.violations.append(f"{name}: no sentence: {str(error)[:200]}")
            except BaseException as error:
                part.violations.append(f"{name}: {type(error).__name__}: {str(error)[:200]}")
            if time.monotonic() - begin > 5.0:
                part.violations.append(f"{name} took {time.monotonic() - begin:.0f} s")
            part.tried += 1
    return part


# Plugins


def harmed(bench: Bench, ending: str, name: str, backend: str, scheduler: str | None) -> list[str]:
    """Run a misbehaving plugin beside two rivals, whose records must be what they are without it."""
    head, lines = getattr(misbehaving, ending)[name]
    with tempfile.TemporaryDirectory(dir=bench.home) as place:
        plugin = write_plugin(Path(place), lines, head=head)
        specs = tiny_plan([plugin, "nearest", "random"], trials=2)
        store = Store(Path(place) / "own")
        store.open(0, "evaluate", TINY)
        check_runnable(specs, 2, backend, 2.0)
        options = {"timeout": 4.0, "memory": 2.0, "scheduler": scheduler}
        table = complete(specs, store, 2, backend, **options)
        found = [] if len(table) == len(specs) else [f"{len(table)} rows of {len(specs)} trials"]
        for spec in specs[2:]:
            whole = bench.whole / "runs" / f"{trial_key(spec)}.parquet"
            same = whole.exists() and read_record(whole).steps.keys() == store.find(spec).steps.keys()
            steps = read_record(whole).steps if same else {}
            if not same or any(not np.array_equal(steps[key], store.find(spec).steps[key]) for key in steps):
                found.append(f"{spec.strategy} in world {spec.trial} came out otherwise")
        own = set(table.loc[table["strategy"] == "Plugin", "status"])
        wanted = {"explored"} if ending == "HARMLESS" else {"failed"}
        found += [] if own == wanted else [f"its trials are {', '.join(own)}"]
        again = {spec.strategy for spec in missing(store, specs)}
        found += [] if again == ({"Plugin"} if ending == "TRANSIENT" else set()) else [f"{again} would run again"]
    return [f"'{name}' with {backend}: {sentence}" for sentence in found]


# All of it


def tries(bench: Bench, share: float, rng: random.Random) -> dict[str, list[Callable[[], list[str]]]]:
    """All that is tried, by part."""

    def few(count: int) -> int:
        return max(round(count * share), 1)

    found: dict[str, list[Callable[[], list[str]]]] = {}
    for what, count in {"run": 110, "report": 40, "merge": 30, "train": 20}.items():
        victims = ("all", "the main process", "a worker") if what == "run" else ("all", "the main process")
        draws = [(random.Random(rng.random()), victims[i % len(victims)]) for i in range(few(count))]
        found[f"{what}, killed"] = [
            lambda what=what, own=own, victim=victim: killed(bench, own, what, victim) for own, victim in draws
        ]
    sizes = np.geomspace(3_000, 3_000_000, few(20)).astype(int).tolist()
    found["a full disk"] = [lambda size=size: full_disk(bench, size) for size in sizes]
    found["a read-only disk"] = [lambda: read_only(bench)]
    found["two writers"] = [lambda: two_writers(bench)] * few(10)
    cases = [(ending, name) for ending in ("HARMLESS", "FAILING", "TRANSIENT") for name in getattr(misbehaving, ending)]
    chosen = rng.sample(cases, few(len(cases)))
    found["misbehaving plugins"] = [lambda case=case: harmed(bench, *case, "processes", None) for case in chosen]
    return found


def clustered(bench: Bench, share: float, rng: random.Random) -> Part:
    """Misbehaving plugins on a dask cluster of this machine."""
    part = Part("the same on dask")
    try:
        from distributed import LocalCluster
    except ImportError:
        part.why_not = "dask is not installed"
        return part
    cases = [(ending, name) for ending in ("HARMLESS", "FAILING", "TRANSIENT") for name in getattr(misbehaving, ending)]
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        for case in rng.sample(cases, max(round(len(cases) * share), 1)):
            part.violations += harmed(bench, *case, "dask", cluster.scheduler_address)
            part.tried += 1
    return part


def tortured(share: float, only: str = "", seed: int = 0) -> list[Part]:
    """Try a share of everything."""
    rng = random.Random(seed)
    process.GRACE, runner.CHECK_SECONDS = 2.0, 2.0  # who cannot be interrupted need not be waited for here
    parts = []
    with tempfile.TemporaryDirectory(prefix="torture-") as home:
        bench = prepared(Path(home))
        for name, own in tries(bench, share, rng).items():
            if only not in name:
                continue
            part = Part(name)
            for one in own:
                try:
                    part.violations += one()
                except NotTriedError as error:
                    part.why_not = str(error)
                    break
                part.tried += 1
            parts.append(part)
        parts += [fuzzed(bench, max(round(10_000 * share), 1), rng)] if only in "wounded files" else []
        parts += [clustered(bench, share, rng)] if only in "the same on dask" else []
    return parts


def table_of(parts: list[Part]) -> str:
    """Return the table as Markdown."""
    rows = [f"| {p.name} | {p.tried or 'not tried: ' + p.why_not} | {len(p.violations)} |" for p in parts]
    return "\n".join(["| what | tried | violated |", "|---|---|---|", *rows])


def main() -> None:
    """Try, and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--share", type=float, default=1.0)
    parser.add_argument("--only", default="")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    parts = tortured(asked.share, asked.only, asked.seed)
    print(table_of(parts))
    violations = [f"- {part.name}: {sentence}" for part in parts for sentence in part.violations]
    print("\n".join(violations))
    sys.exit(1 if violations else 0)


if __name__ == "__main__":
    main()
