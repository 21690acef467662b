"""The confirmation: whether ours beats all others in worlds that nobody has seen, after the code is frozen.

    python docs/studies/confirm.py [--out FOLDER] [--workers N] [--check]

`attempts.toml` in results/confirmation declares every attempt before it is run: its root seed, worlds a size, sizes,
metrics, and who is said to be better; the family is that strategy against every other one of the suite `confirmation`
that is no reference, in every metric and size, with Holm's correction over all of it. The attempt that has no answer
yet is run, once: its root seed is used by no other, and what came out is written beside the declaration, as ROOT.md,
ROOT.json and ROOT.csv (means), and stays whatever it says, with a digest of the keys of its trials: code that gives
another one is not the code that ran them. An interrupted one goes on. --check only says whether the declarations are in
order.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path

import explore_bench
from explore_bench.analysis.claims import Claim, as_values, comparisons, examine, verdict
from explore_bench.analysis.csv_files import write_table
from explore_bench.analysis.tables import measured, summary_table
from explore_bench.errors import RequestError
from explore_bench.files import write_whole
from explore_bench.records.provenance import trial_key
from explore_bench.report.pages.claims import comparison_table, summary
from explore_bench.runs.suites import plan
from explore_bench.strategies.registry import lookup

FOLDER = Path(__file__).parents[2] / "results" / "confirmation"
SUITE = "confirmation"


@dataclass(frozen=True)
class Attempt:
    """One declared attempt.

    Attributes
    ----------
    root : seed of its worlds; 0 is the benchmark's own.
    better : strategy that is said to beat all others.
    metrics, sizes, worlds : in what, where [m], and in how many worlds a size.
    """

    root: int
    better: str
    metrics: tuple[str, ...]
    sizes: tuple[float, ...]
    worlds: int


def attempts(file: Path) -> list[Attempt]:
    """All declared attempts, the first one first.

    Raises
    ------
    RequestError : where two have the same root seed, or one has the benchmark's own.
    """
    declared = [
        Attempt(one["root"], one["better"], tuple(one["metrics"]), tuple(map(float, one["sizes"])), one["worlds"])
        for one in tomllib.loads(file.read_text(encoding="utf-8")).get("attempt", [])
    ]
    roots = [0, *(one.root for one in declared)]
    for root in roots:
        if roots.count(root) > 1:
            raise RequestError(f"root seed {root} is used twice; declare another attempt with one of its own.")
    return declared


def others(attempt: Attempt) -> list[str]:
    """Everybody whom the one said to be better is compared with."""
    found = [spec.strategy for spec in plan(SUITE, trials=1).specs if not spec.reference]
    return [name for name in dict.fromkeys(found) if name != attempt.better]


def claim_of(attempt: Attempt) -> Claim:
    """All comparisons of an attempt."""
    _, entry = lookup(attempt.better)
    return Claim(
        str(attempt.root),
        f"{entry.label} is better than every other strategy, in worlds of root seed {attempt.root}.",
        comparisons(attempt.better, others(attempt), attempt.metrics, attempt.sizes),
        architecture=False,
    )


def digest(attempt: Attempt) -> str:
    """Digest of the keys that the trials of an attempt have by the present code."""
    names = [attempt.better, *others(attempt)]
    specs = plan(SUITE, names, attempt.sizes, attempt.worlds, root=attempt.root).specs
    return hashlib.sha256("".join(sorted(map(trial_key, specs))).encode()).hexdigest()[:20]


def write(attempt: Attempt, out: Path, workers: int | None) -> None:
    """Run what is missing of an attempt and write what came out."""
    names = [attempt.better, *others(attempt)]
    folder = out / str(attempt.root)
    trials = measured(
        explore_bench.run(
            SUITE,
            names,
            sizes=attempt.sizes,
            trials=attempt.worlds,
            workers=workers,
            seed=attempt.root,
            results=folder,
        )
    )
    claim = claim_of(attempt)
    found = examine(claim, trials)
    keys = digest(attempt)
    page = [
        f"## {attempt.root}: {verdict(found)}. {summary(found)}\n",
        f"Digest of the keys of its {len(trials)} trials: `{keys}`.\n",
        comparison_table(claim, found).markdown(),
    ]
    write_table(summary_table(trials), out / f"{attempt.root}.csv")
    write_whole(
        out / f"{attempt.root}.json",
        json.dumps({**as_values(claim, found), "keys": keys}, indent=1, ensure_ascii=False) + "\n",
    )
    write_whole(out / f"{attempt.root}.md", "\n".join(page))


def main() -> None:
    """Run the attempt that has no answer yet, and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=FOLDER)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--check", action="store_true")
    asked = parser.parse_args()
    declared = attempts(asked.out / "attempts.toml")
    for attempt in declared:
        answer = asked.out / f"{attempt.root}.md"
        if not answer.exists():
            print(f"{attempt.root}: {len(claim_of(attempt).comparisons)} comparisons, not run yet", flush=True)
            if asked.check:
                continue
            write(attempt, asked.out, asked.workers)
        print(answer.read_text(encoding="utf-8").partition("\n")[0].lstrip("# "))


if __name__ == "__main__":
    main()
