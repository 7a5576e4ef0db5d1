"""The notebook of the tutorial runs, and prints what it shows."""

import os

import pytest
from blocks import ROOT, alike

pytestmark = pytest.mark.slow
NOTEBOOK = ROOT / "docs/tutorial/notebook.ipynb"


def printed(notebook):
    """The text of each code cell's outputs, without figures."""
    return [
        "".join(o.get("text") or o.get("data", {}).get("text/plain", "") for o in cell.outputs)
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]


@pytest.fixture(scope="module")
def pages():
    import nbformat
    from nbclient import NotebookClient

    shown = nbformat.read(NOTEBOOK, 4)
    run = nbformat.read(NOTEBOOK, 4)
    os.environ["PYTHONPATH"] = str(ROOT / "src")
    NotebookClient(
        run, timeout=300, resources={"metadata": {"path": str(NOTEBOOK.parent)}}
    ).execute()
    return printed(shown), printed(run), run


def test_the_notebook_prints_what_it_shows(pages):
    shown, run, _ = pages
    for before, now in zip(shown, run, strict=True):
        assert alike(before, now), f"{before}\n---\n{now}"


def test_the_notebook_finds_the_spring_that_it_hides(pages):
    _, run, notebook = pages
    assert any(text.startswith("Missing effect on lwr_3_joint: spring") for text in run)
    without, with_it = (float(line.split(":")[1].split()[0]) for line in run[-1].splitlines())
    assert with_it < 0.1 * without
    assert any(
        "image/png" in o.get("data", {}) for cell in notebook.cells for o in cell.get("outputs", [])
    )
