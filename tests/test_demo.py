"""``python -m unitsel.demo``, without footage and with the puppet's."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import cv2
import pytest

from analysis.face import FaceModels
from database.media import probe
from database.reader import open_database
from database.timing import read_timing
from unitsel.demo import CLIPS_ENV, CORPUS_ENV, main


def test_without_footage_a_photo_speaks_and_it_says_how_to_point_it_at_some(
    face_models: FaceModels,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    can_speak = importlib.util.find_spec("espeakng_loader") is not None
    here = tmp_path / "a" / "b"
    here.mkdir(parents=True)
    monkeypatch.chdir(here)
    monkeypatch.delenv(CORPUS_ENV, raising=False)
    assert main() == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert f"{CORPUS_ENV}=/path/to/clips make demo" in out
    assert "hello.txt" in out
    if not can_speak:
        assert "espeak" in out
        return
    for language in ("en", "zh"):
        video = probe(here / "out" / f"portrait-{language}.mp4")
        assert video.has_sound and 2 < video.frames / 25 < 10
        assert (here / "out" / f"portrait-{language}.png").is_file()


def test_with_footage_it_writes_a_video_and_a_contact_sheet(
    puppet_corpus: Path,
    puppet: ModuleType,
    face_models: FaceModels,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(CORPUS_ENV, str(puppet_corpus))
    monkeypatch.setenv(CLIPS_ENV, "3")
    assert main() == 0
    out, err = capsys.readouterr()
    assert err == ""
    clips = sorted(p.stem for p in puppet_corpus.glob("*.mp4"))
    left_out = clips[len(clips) // 2]
    with open_database("out/demo.h5") as database:
        assert left_out not in database.sequences.name
        assert len(database.sequences) == 3
    timing = read_timing("out/demo.TextGrid")
    assert timing.phones is not None
    video = probe("out/demo.mp4")
    assert video.has_sound
    assert video.frames == round(timing.phones.end * 25)
    sheet = cv2.imread("out/demo.png")
    assert sheet is not None and sheet.shape[1] == 8 * 200 and sheet.shape[0] % 400 == 0
    assert "out/demo.mp4" in out and left_out in out and "r =" in out
    files = {"demo.TextGrid", "demo.h5", "demo.h5.shards", "demo.mp4", "demo.png"}
    if puppet.can_speak():
        files |= {"demo-say.mp4", "demo-say.png", "portrait.h5"}
        files |= {f"portrait-{s}.{e}" for s in ("en", "zh") for e in ("mp4", "png")}
        said = probe("out/demo-say.mp4")
        assert said.has_sound and said.duration > 2
        sheet = cv2.imread("out/demo-say.png")
        assert sheet is not None and sheet.shape == (2 * 200, 6 * 200, 3)
        assert "This is a new sentence" in out
    assert {p.name for p in Path("out").iterdir()} == files


@pytest.mark.parametrize(
    ("corpus", "clips", "named"),
    [("nowhere", "", "nowhere"), (".", "", ".: holds no media"), (".", "one", CLIPS_ENV)],
)
def test_bad_settings_are_told_in_one_line(
    corpus: str,
    clips: str,
    named: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(CORPUS_ENV, corpus)
    monkeypatch.setenv(CLIPS_ENV, clips)
    assert main() == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1 and named in err
    assert list(tmp_path.iterdir()) == []
