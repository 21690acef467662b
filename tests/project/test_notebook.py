"""The notebook of a first look: it runs from end to end, and is committed as it was written.

Without outputs, that is: pictures would be most of its bytes, change with every run, and be stale with every change.
"""

import ast
import base64
import io
import json
from pathlib import Path

import pytest
from PIL import Image

import explore_bench

NOTEBOOK = Path(__file__).parents[2] / "examples" / "first_look.ipynb"


def code_cells():
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def test_the_notebook_is_committed_without_outputs():
    assert len(code_cells()) >= 4
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code_cells())


def test_the_notebook_uses_public_names():
    trees = [ast.parse("".join(cell["source"])) for cell in code_cells()]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    used = {ast.unparse(node) for node in nodes if isinstance(node, ast.Attribute)}
    names = {name.removeprefix("explore_bench.") for name in used if name.startswith("explore_bench.")}
    assert names
    assert names <= explore_bench.PUBLIC.keys()
    assert not [node for node in nodes if isinstance(node, ast.ImportFrom) and "explore_bench" in str(node.module)]


@pytest.mark.slow
def test_the_notebook_runs_three_strategies_shows_a_trial_moving_and_plots_the_ranking(tmp_path):
    nbformat = pytest.importorskip("nbformat", reason="nbclient is not installed")
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
    pytest.importorskip("ipykernel", reason="ipykernel is not installed")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [output.data for cell in notebook.cells for output in cell.get("outputs", []) if "data" in output]
    rows, moving, ranking, means = shown
    assert all(rows["text/plain"].count(name) >= 1 for name in ("nearest", "entropy", "random"))
    assert rows["text/plain"].count("explored") == 12
    with Image.open(io.BytesIO(base64.b64decode(moving["image/gif"]))) as picture:
        assert picture.n_frames > 3
    with Image.open(io.BytesIO(base64.b64decode(ranking["image/png"]))) as picture:
        assert picture.width > 500
    order = [line.split()[0] for line in means["text/plain"].splitlines()[2:]]
    assert sorted(order) == ["entropy", "nearest", "random"]
    assert order[-1] == "random"
    assert (tmp_path / "first_look" / "trials.csv").is_file()
