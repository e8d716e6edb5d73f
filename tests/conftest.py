"""What several test files share: a made-up database, the corpus if there is one, a portrait."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType

import cv2
import matplotlib
import numpy as np
import pytest

HERE = Path(__file__).parent
ROOT = HERE.parent


@pytest.fixture(scope="session")
def makedb() -> ModuleType:
    """Load `makedb.py` of this folder (importlib mode puts no test folder on the path)."""
    name = "makedb"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, HERE / "makedb.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


@pytest.fixture(scope="session")
def small_db(makedb: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a small database file; tests read it and leave it as it is."""
    return makedb.make_database(tmp_path_factory.mktemp("database") / "small.h5")


def _folder(variable: str, below_shared: str) -> Path:
    named = os.environ.get(variable)
    folder = Path(named) if named else ROOT.parent / "shared" / below_shared
    if not folder.is_dir():
        pytest.skip(f"needs footage: no folder {folder}; set {variable} to one")
    return folder


@pytest.fixture(scope="session")
def corpus() -> Path:
    """Folder of clips to build databases from."""
    return _folder("UNITSEL_CORPUS", "corpus/grid-s1/build")


@pytest.fixture(scope="session")
def heldout() -> Path:
    """Folder of clips that no database is built from."""
    return _folder("UNITSEL_HELDOUT", "corpus/grid-s1/heldout")


@pytest.fixture(scope="session")
def portrait() -> np.ndarray:
    """Grace Hopper, (height, width, 3) uint8 RGB: a real face, mouth closed."""
    path = Path(matplotlib.get_data_path()) / "sample_data" / "grace_hopper.jpg"
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
    assert picture is not None, path
    return picture
