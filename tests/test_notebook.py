"""The notebook runs from end to end and is kept without its output."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest

from database.reader import open_database

nbclient = pytest.importorskip("nbclient", reason="needs the extra unitsel[notebook]")
nbformat = pytest.importorskip("nbformat", reason="needs the extra unitsel[notebook]")

TOUR = Path(__file__).parent.parent / "notebooks" / "tour.ipynb"


@pytest.fixture(scope="module")
def executed(small_db: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The notebook after a run on a small database, in a folder of its own."""
    folder = tmp_path_factory.mktemp("notebook")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("UNITSEL_NOTEBOOK_DB", str(small_db))
        for variable in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_DATA_DIR"):
            patch.setenv(variable, str(folder / variable.lower()))
        # In a notebook pictures are drawn into it; a backend chosen outside would hide them.
        patch.delenv("MPLBACKEND", raising=False)
        notebook = nbformat.read(TOUR, as_version=4)
        client = nbclient.NotebookClient(
            notebook,
            timeout=120,
            kernel_name="python3",
            resources={"metadata": {"path": os.fspath(folder)}},
        )
        client.execute()
    assert not (folder / "tour.h5").exists(), "it built a database though one was named"
    return notebook


def _printed(notebook: Any) -> str:
    outputs = [o for c in notebook.cells if c.cell_type == "code" for o in c.outputs]
    return "".join(o.text for o in outputs if o.output_type == "stream" and o.name == "stdout")


def test_counts_are_those_of_the_database(executed: Any, small_db: Path) -> None:
    with open_database(small_db) as db:
        units, sequences = len(db), len(db.sequences)
        labels = db.sequence_track(0).labels
    printed = _printed(executed)
    assert f"{units} units of {sequences} sequences" in printed
    assert " ".join(labels) in printed


def test_selects_other_clips_than_the_spoken_one(executed: Any) -> None:
    found = re.search(r"(\d+) frames in (\d+) recorded pieces", _printed(executed))
    assert found is not None
    frames, pieces = map(int, found.groups())
    # Its own clip would give all frames in one piece.
    assert 1 < pieces < frames


def test_draws_counts_trajectories_and_the_strip(executed: Any) -> None:
    drawn = [
        o.data["image/png"]
        for c in executed.cells
        if c.cell_type == "code"
        for o in c.outputs
        if o.output_type == "display_data"
    ]
    assert len(drawn) == 3


def test_is_kept_without_output() -> None:
    notebook = nbformat.read(TOUR, as_version=4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert not cell.outputs and cell.execution_count is None, cell.source
