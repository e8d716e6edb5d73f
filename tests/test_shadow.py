"""Somebody else's module of one of our floors' names is noticed, and which file it is.

`database`, `analysis` and `render` are names that a user's folder may well hold; Python then
takes theirs, and the failure would be a riddle.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import unitsel

OURS = Path(unitsel.__file__).parent.parent

SHADOWS = {
    "database.py": "database.py",
    "render.py": "render.py",
    "analysis/__init__.py": "analysis",
    "database/__init__.py": "database",
    # A folder without __init__.py: a namespace package would lose against ours, a module wins.
    "analysis.py": "analysis.py",
}


def _import_unitsel(folder: Path, first: str = "") -> subprocess.CompletedProcess[str]:
    """Import unitsel in a fresh interpreter with `folder` before everything else."""
    code = f"import sys; sys.path.insert(0, {str(folder)!r}); {first}import unitsel; print('fine')"
    # Our own folder comes last where it is no installed one.
    environment = {**os.environ, "PYTHONPATH": "", "PYTHONSAFEPATH": "1"}
    if OURS.name != "site-packages":
        code = code.replace("import sys; ", f"import sys; sys.path.append({str(OURS)!r}); ", 1)
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize("shadow", SHADOWS)
def test_names_the_file_that_hides_ours(shadow: str, tmp_path: Path) -> None:
    file = tmp_path / shadow
    file.parent.mkdir(exist_ok=True)
    file.write_text('"""Somebody else\'s."""\n')
    done = _import_unitsel(tmp_path)
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 1
    assert last.startswith("ImportError: ")
    assert str(file) in last
    assert f"hides unitsel's own package '{Path(shadow).parts[0].removesuffix('.py')}'" in last


def test_names_a_module_that_was_imported_before(tmp_path: Path) -> None:
    file = tmp_path / "render.py"
    file.write_text('"""Somebody else\'s."""\n')
    done = _import_unitsel(tmp_path, first="import render; ")
    assert done.returncode == 1
    assert str(file) in done.stderr.strip().splitlines()[-1]


def test_says_nothing_where_nothing_is_hidden(tmp_path: Path) -> None:
    (tmp_path / "databases.py").write_text("")
    done = _import_unitsel(tmp_path)
    assert (done.returncode, done.stdout) == (0, "fine\n"), done.stderr
