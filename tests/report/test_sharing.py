"""A report whose reading and drawing is shared out among processes: the same bytes, whatever becomes of these."""

import pytest

from explore_bench.report import sharing
from explore_bench.report.render import write_report
from explore_bench.runs.workers.process import LostError


@pytest.fixture
def alone(own_store):
    """Bytes of every file of a report that this process writes alone."""
    written = {file: file.read_bytes() for file in write_report(own_store.folder).files}
    assert any(file.suffix == ".svg" for file in written)
    for file in written:
        file.unlink()
    return written


@pytest.fixture
def shared(monkeypatch):
    """Share out also a small report, in several parts."""
    monkeypatch.setattr(sharing, "LARGE", 1)
    monkeypatch.setattr(sharing, "SHARDS", 4)


def test_shared_out_a_report_has_the_same_bytes(own_store, alone, shared, monkeypatch):
    asked = []
    results_of = sharing.results_of

    def watched(jobs, workers):
        asked.append(len(jobs))
        return results_of(jobs, workers)

    monkeypatch.setattr(sharing, "results_of", watched)
    report = write_report(own_store.folder)
    assert {file: file.read_bytes() for file in report.files} == alone
    pictures = sum(file.suffix == ".svg" for file in alone)
    assert asked == [3, pictures], "nine trials in parts of four, and every figure"


def test_a_small_report_starts_no_process(own_store, monkeypatch):
    monkeypatch.setattr(sharing, "results_of", lambda jobs, workers: pytest.fail("a process is asked"))
    assert write_report(own_store.folder).trials == 9


def test_what_the_processes_lose_is_done_here(own_store, alone, shared, monkeypatch):
    def lose(jobs, workers):
        yield from ((number, LostError("its worker process died")) for number in reversed(range(len(jobs))))

    monkeypatch.setattr(sharing, "results_of", lose)
    report = write_report(own_store.folder)
    assert {file: file.read_bytes() for file in report.files} == alone


def test_what_a_process_finds_damaged_or_stale_is_said(own_store, shared):
    first, second, *_ = own_store.shards()
    first.write_bytes(first.read_bytes()[:-7])
    second.rename(second.with_name("0" * 20 + ".parquet"))
    report = write_report(own_store.folder)
    assert (report.trials, report.stale) == (7, 1)
    assert report.damaged == (own_store.runs / "damaged" / first.name,)
    assert report.damaged[0].exists()
