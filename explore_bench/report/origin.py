"""Where the numbers come from: versions, commit, machine, digests, seeds and trainings, as tables.

Nothing in them changes from run to run on one machine: there is no time, no path and no user.
"""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from explore_bench.files import parse_json, read_text
from explore_bench.records.encoding import TrialRecord
from explore_bench.records.provenance import LIBRARIES, code_digest, installed_version, scenario_digest, weights_digest
from explore_bench.report.tables import Scope, Table, shown_name
from explore_bench.strategies.entry import parse_factory, weights_file
from explore_bench.trial.spec import TrialSpec
from explore_bench.trial.steps import SCHEMA_VERSION

SHOWN_DIGITS = 12
"""Hexadecimal digits shown of a digest."""

REPORT_LIBRARIES = ("matplotlib", "pandas", "pyarrow", "jinja2")


def origin_tables(records: Sequence[TrialRecord]) -> tuple[Table, ...]:
    """Tables of the protocol, the software and the machine, and the strategies."""
    return protocol_table(records), software_table(), strategies_table(records)


def protocol_table(records: Sequence[TrialRecord]) -> Table:
    """Seeds, sizes with the digests of their constants, and how many worlds and trials."""
    specs = [record.spec for record in records]
    seeds = sorted({spec.training_seed for spec in specs if spec.training_seed is not None})
    rows = [
        ("root seed", ", ".join(map(str, sorted({spec.root for spec in specs})))),
        ("training seeds", ", ".join(map(str, seeds)) or "none"),
        ("purpose of the random streams", ", ".join(sorted({spec.purpose for spec in specs}))),
        ("record version", str(SCHEMA_VERSION)),
    ]
    for scenario in sorted({spec.scenario for spec in specs}, key=lambda one: one.size):
        worlds = len({spec.trial for spec in specs if spec.scenario == scenario})
        names = ", ".join(sorted({spec.scenario_name for spec in specs if spec.scenario == scenario}))
        rows.append(
            (f"scenario '{names}', {scenario.size:g} m", f"{worlds} worlds, digest {scenario_digest(scenario)}")
        )
    return Table("Protocol", ("what", "value"), tuple(rows))


def software_table() -> Table:
    """Versions, commit and machine."""
    rows = [("explore-bench", installed_version("explore-bench")), ("commit", commit() or "not in a git checkout")]
    rows += [("Python", f"{platform.python_implementation()} {platform.python_version()}")]
    rows += [(name, installed_version(name)) for name in (*LIBRARIES, *REPORT_LIBRARIES)]
    rows += [("system", f"{platform.system()} {platform.machine()}"), ("processor", processor())]
    rows += [("cores", str(os.cpu_count() or "unknown"))]
    note = "A stored trial counts only while the code and the versions of the libraries that it ran are these."
    return Table("Software and machine", ("what", "value"), tuple(rows), note)


def strategies_table(records: Sequence[TrialRecord]) -> Table:
    """Digests of the code and the weights of every strategy and training seed, and how it was trained."""
    specs: dict[tuple[str, int | None], TrialSpec] = {}
    for record in records:
        specs.setdefault((record.spec.strategy, record.spec.training_seed), record.spec)
    rows = [
        (
            shown_name(name),
            "–" if seed is None else str(seed),
            _code(spec),
            weights_digest(spec.weights)[:SHOWN_DIGITS] if spec.weights else "–",
            *_training(spec),
        )
        for (name, seed), spec in specs.items()
    ]
    header = ("Method", "training seed", "code", "weights", "network's parameters", "training command")
    scopes = tuple(Scope((name,)) for name, _ in specs)
    return Table("Strategies", header, tuple(rows), "SHA-256, first digits.", scopes)


def commit(folder: Path = Path(__file__).parents[2]) -> str:
    """Commit that is checked out in a folder, by default the one that holds this package; empty where none is."""
    git = folder / ".git"
    try:
        if git.is_file():  # a worktree or a submodule
            git = (git.parent / git.read_text(encoding="utf-8").removeprefix("gitdir:").strip()).resolve()
        head = (git / "HEAD").read_text(encoding="utf-8").strip()
        if not head.startswith("ref:"):
            return _hexadecimal(head)
        name = head.removeprefix("ref:").strip()
        common = git / "commondir"
        homes = [git, (git / common.read_text(encoding="utf-8").strip()).resolve()] if common.is_file() else [git]
        return next((found for home in homes if (found := _reference(home, name))), "")
    except (OSError, UnicodeDecodeError):
        return ""


def _reference(home: Path, name: str) -> str:
    """Commit of a branch, from its own file or the packed ones; empty where neither has it."""
    if (home / name).is_file():
        return _hexadecimal((home / name).read_text(encoding="utf-8").strip())
    packed = home / "packed-refs"
    lines = packed.read_text(encoding="utf-8").splitlines() if packed.is_file() else []
    return next((_hexadecimal(line.split()[0]) for line in lines if line.endswith(f" {name}")), "")


def _hexadecimal(text: str) -> str:
    return text if re.fullmatch(r"[0-9a-f]{40,64}", text) else ""


def processor() -> str:
    """Name of the processor, as far as the system tells."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        text = ""
    named = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return named[1].strip() if named else platform.processor() or platform.machine() or "unknown"


def _code(spec: TrialSpec) -> str:
    try:
        return code_digest(parse_factory(spec.factory)[0], spec.scenario.kind)[:SHOWN_DIGITS]
    except OSError:  # a plugin's file that is gone
        return "–"


def _training(spec: TrialSpec) -> tuple[str, str]:
    """Number of parameters and command of a training, from the card beside the weights."""
    if not spec.weights:
        return "–", "–"
    card = card_of(spec.weights)
    if card is None:
        return "–", "no card"
    count, command = card.get("parameter_count"), card.get("command")
    return (f"{count:,}" if isinstance(count, int) else "–"), (str(command) if command else "not in the card")


def card_of(weights: str) -> dict[str, Any] | None:
    """Card beside a file of weights, which tells of its training; None where there is none that can be read."""
    try:
        card = parse_json(read_text(weights_file(weights).with_suffix(".json")))
    except (OSError, ValueError):
        return None
    return card if isinstance(card, dict) else None
