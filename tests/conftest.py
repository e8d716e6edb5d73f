"""What several test files share: databases made up or filmed, footage if there is any."""

from __future__ import annotations

import fcntl
import importlib.util
import os
import pickle
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import matplotlib.cbook as cbook
import numpy as np
import pytest

from analysis.build import BuildReport, build_database
from analysis.face import FaceFinder
from analysis.models import CHECKSUMS, MODELS_ENV, FaceModels, cache_folder, find_models
from analysis.portrait import make_portrait
from database.timing import Timing, write_timing
from unitsel.cli import main

HERE = Path(__file__).parent
ROOT = HERE.parent


def _helper(name: str) -> ModuleType:
    """Load a module of this folder (importlib mode puts no test folder on the path)."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


@pytest.fixture(scope="session")
def makedb() -> ModuleType:
    """Give `makedb.py`: databases made up without footage."""
    return _helper("makedb")


@pytest.fixture(scope="session")
def puppet() -> ModuleType:
    """Give `puppet.py`: a talking person without footage."""
    return _helper("puppet")


@pytest.fixture(scope="session")
def portrait_corpus() -> ModuleType:
    """Give `portrait_corpus.py`: clips of a portrait of which everything is known."""
    return _helper("portrait_corpus")


@pytest.fixture(scope="session")
def face_models() -> FaceModels:
    """Find the face models without fetching them."""
    there = os.environ.get(MODELS_ENV) or all((cache_folder() / n).is_file() for n in CHECKSUMS)
    if not there:
        pytest.skip("needs the face models: run python -m analysis.models, or `make setup`, once")
    return find_models()


@pytest.fixture
def finder(face_models: FaceModels) -> FaceFinder:
    """Give a face finder that has seen nothing yet."""
    return FaceFinder(face_models)


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], Any]], Any]:
    """Give what a function makes in an empty folder, made once for all of xdist's workers."""
    base = tmp_path_factory.getbasetemp()
    place = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def made(name: str, make: Callable[[Path], Any]) -> Any:
        folder, result = place / name, place / f"{name}.pickle"
        with (place / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not result.is_file():
                folder.mkdir()
                result.write_bytes(pickle.dumps(make(folder)))
            return pickle.loads(result.read_bytes())

    return made


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let a second process do what needs no puppet while the first one builds it."""
    puppets = {
        item.path
        for item in items
        if isinstance(item, pytest.Function) and "puppet_corpus" in item.fixturenames
    }
    first = min(puppets, default=None)
    items.sort(key=lambda item: -1 if item.path == first else int(item.path in puppets))


@pytest.fixture(scope="session")
def puppet_corpus(puppet: ModuleType, once: Callable[..., Any]) -> Path:
    """Make a corpus of the puppet; tests read it and leave it as it is."""
    return Path(once("puppet", puppet.make_corpus))


@pytest.fixture(scope="session")
def puppet_report(
    puppet_corpus: Path, face_models: FaceModels, once: Callable[..., Any]
) -> BuildReport:
    """Build a database from the puppet's corpus."""
    report = once("built", lambda f: build_database(puppet_corpus, f / "puppet.h5", jobs=1))
    assert isinstance(report, BuildReport)
    return report


@pytest.fixture(scope="session")
def puppet_db(puppet_report: BuildReport) -> Path:
    """Give the database of the puppet; tests read it and leave it as it is."""
    return puppet_report.path


@pytest.fixture(scope="session")
def short_corpus(puppet: ModuleType, once: Callable[..., Any]) -> Path:
    """Three clips of a second each; one with words alone where there is speech."""

    def make(folder: Path) -> Path:
        for seed, sentence in enumerate(("bin blue now", "lay red soon", "place white again")):
            track, words = puppet.even_track(sentence, 0.2, 0.5)
            sound = puppet.hum(track, seed)
            if seed == 2 and puppet.can_speak():
                sound, track = puppet.speak(sentence, 0.15)
                (folder / "clip2.txt").write_text(sentence)
            else:
                write_timing(folder / f"clip{seed}.TextGrid", Timing(track, words))
            puppet.write_clip(folder / f"clip{seed}.mp4", track, sound, seed)
        return folder

    return Path(once("short", make))


@pytest.fixture
def no_traces(tmp_path: Path) -> Iterator[Path]:
    """Give a folder for the output; afterwards it holds databases and kept clips, nothing else."""
    folder = tmp_path / "out"
    folder.mkdir()
    yield folder
    assert [p.name for p in folder.iterdir() if p.suffix not in (".h5", ".shards")] == []
    assert not list(folder.rglob("*.partial"))


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
def portrait(puppet: ModuleType) -> np.ndarray:
    """Grace Hopper, (height, width, 3) uint8 RGB: a real face, mouth closed."""
    return puppet.portrait()


@pytest.fixture(scope="session")
def portrait_photo() -> Path:
    """Give the file of the portrait that matplotlib ships."""
    return Path(str(cbook.get_sample_data("grace_hopper.jpg", asfileobj=False)))


@pytest.fixture(scope="session")
def portrait_head(
    portrait_photo: Path, face_models: FaceModels, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Make a head of the portrait; tests read it and leave it as it is."""
    path = tmp_path_factory.mktemp("head") / "grace.h5"
    make_portrait(portrait_photo, path)
    return path


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Call the command in this process: exit status, standard output, standard error."""

    def call(*arguments: object) -> tuple[int, str, str]:
        status = main([str(a) for a in arguments])
        said = capsys.readouterr()
        return status, said.out, said.err

    return call
