"""``unitsel doctor``: reports on databases and folders, as text, JSON and a page."""

from __future__ import annotations

import base64
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from analysis.models import FaceModels
from database.errors import CorpusError, DatabaseError
from database.pictures import encode
from database.writer import store_selection, write_database
from unitsel.doctor.page import doctor_page, write_doctor_page
from unitsel.doctor.quality import Quality
from unitsel.doctor.report import DoctorReport, doctor_report
from unitsel.settings import settings_for

Run = Callable[..., tuple[int, str, str]]

VOID = {"meta", "br", "img"}


class Page(HTMLParser):
    """The page's elements; fails where a tag is not closed as it was opened."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(html)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self._open:
            self.text += data

    def all(self, name: str) -> list[str]:
        return [a[name] or "" for _, a in self.elements if name in a]


def _checked(html: str) -> Page:
    """A page that fetches nothing, whose links lead somewhere and whose pictures open."""
    page = Page(html)
    assert "<script" not in html and "http-equiv" in html
    assert not re.search(r"(?:https?:)?//[a-z]", re.sub(r"base64,[^\"]+", "", html))
    ids = page.all("id")
    assert len(set(ids)) == len(ids)
    assert all(h[0] == "#" and h[1:] in ids for h in page.all("href"))
    for source in page.all("src"):
        head, _, code = source.partition(",")
        assert head == "data:image/jpeg;base64"
        picture = cv2.imdecode(np.frombuffer(base64.b64decode(code), np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
    assert not re.search(r"\b(?:nan|inf|None)\b", page.text)
    return page


@pytest.fixture(scope="module")
def faulty_db(makedb: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a database whose build skipped a clip and repaired others, all footage gone."""
    content, pictures, landmarks = makedb.make_content()
    names = content.sequences.name
    content = replace(
        content,
        report={
            "skipped": [{"clip": "lost<b>", "reason": "lost<b>.mp4: has no words & no hope"}],
            "repaired": [
                {"clip": names[0], "note": "lips move 0.08 s earlier than the sound; phones moved"},
                {"clip": names[2], "note": "aligned at attempt 4"},
                {"clip": names[3], "note": "word 'in' at 1.23 s was not heard; its phones share"},
            ],
        },
    )
    path = tmp_path_factory.mktemp("faulty") / "faulty.h5"
    write_database(path, content, (encode(p, "png") for p in pictures), landmarks, "png")
    return path


@pytest.fixture(scope="module")
def faulty(faulty_db: Path) -> DoctorReport:
    """Give the report on it."""
    return doctor_report(faulty_db, sentences=4, advice=5)


def test_a_database_s_clips_are_told(faulty: DoctorReport, makedb: ModuleType) -> None:
    by_name = {c.name: c for c in faulty.clips}
    assert faulty.built and len(faulty.usable) == 6
    assert [c.error for c in faulty.skipped] == ["lost<b>.mp4: has no words & no hope"]
    assert by_name["clip00"].lag == -0.08
    assert by_name["clip01"].rejected[0].frames == makedb.MISSING
    assert faulty.rejected_frames == len(makedb.MISSING)
    assert "clip00" not in faulty.doubts or "lips move" not in str(faulty.doubts["clip00"])
    assert faulty.doubts["clip02"][0] == "aligned at attempt 4"
    assert faulty.doubts["clip03"][0].startswith("word 'in'")
    assert set(makedb.LACKING) <= set(faulty.coverage.missing_phonemes())
    assert len(faulty.rotations) == sum(c.faces for c in faulty.usable) == 444
    assert all(c.sound is None for c in faulty.clips)
    assert len(faulty.advice) == 5


def test_quality_lies_between_chance_and_the_best_unit(faulty: DoctorReport) -> None:
    q = faulty.quality
    assert isinstance(q, Quality)
    assert q.sentences == 4 and q.target == "paper" and q.learnt == 1
    for rows in (q.heights, q.textures):
        # Four sentences: the mean of the selected mouths may touch that of the nearest by chance.
        assert rows["random"].mean < rows["selected"].mean < rows["nearest"].high
        assert rows["random"].mean < rows["nearest"].mean
        assert all(m.low <= m.mean <= m.high for m in rows.values())
    assert q.grade in q.verdict
    assert q.worst == tuple(sorted(q.worst, key=lambda w: w[2]))


def test_page_of_a_database(faulty: DoctorReport) -> None:
    html = doctor_page(faulty)
    page = _checked(html)
    for f in faulty.findings:
        assert f.text in page.text
    for a in faulty.advice:
        assert a.sentence in page.text
    assert "lost<b>.mp4: has no words & no hope" in page.text
    assert "20 to 24, 40" in page.text
    assert "80 ms earlier" in page.text
    assert not faulty.faults or page.all("src")


def test_a_page_is_replaced_as_a_whole(faulty: DoctorReport, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")
    write_doctor_page(path, faulty)
    assert path.read_text(encoding="utf-8") == doctor_page(faulty)
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    with pytest.raises(DatabaseError, match="there is no folder"):
        write_doctor_page(tmp_path / "none" / "report.html", faulty)


def test_json_and_text(small_db: Path, run: Run, tmp_path: Path) -> None:
    before = small_db.read_bytes()
    page = tmp_path / "r.html"
    status, out, err = run(
        "doctor", small_db, "--sentences", 0, "--record", 9, "--html", page, "--json"
    )
    assert (status, err, out.count("\n")) == (0, "", 1)
    document = json.loads(out)
    assert document["kind"] == "database" and document["clips"] == document["usable"] == 6
    assert len(document["record_next"]) == 9 and document["quality"]["grade"] is None
    assert document["html"] == str(page)
    assert len(document["per_clip"]) == 6
    _checked(page.read_text(encoding="utf-8"))
    status, out, err = run("doctor", small_db, "--sentences", 0)
    assert (status, err) == (0, "")
    assert "Problem:" in out and document["record_next"][0]["sentence"] in out
    assert "and 17 more" in out
    assert small_db.read_bytes() == before


def test_bad_input_is_one_line_and_leaves_an_old_page(
    small_db: Path, run: Run, tmp_path: Path
) -> None:
    page = tmp_path / "r.html"
    page.write_text("old")
    text = tmp_path / "note.txt"
    text.write_text("no database")
    (tmp_path / "empty").mkdir()
    for source, said in (
        (tmp_path / "nothing", "there is no such folder or database"),
        (text, "is no HDF5 file"),
        (tmp_path / "empty", "holds no media file"),
    ):
        status, out, err = run("doctor", source, "--html", page)
        assert (status, out) == (2, "")
        assert err.count("\n") == 1 and str(source) in err and said in err
    assert page.read_text() == "old"
    for option, value in (
        ("--html", "r.txt"),
        ("--html", tmp_path / "none" / "r.html"),
        ("--sentences", "-1"),
        ("--record", "x"),
        ("--jobs", "0"),
    ):
        status, out, err = run("doctor", small_db, option, value)
        assert (status, out, err.count("\n")) == (2, "", 1)
    with pytest.raises(CorpusError, match="jobs"):
        doctor_report(small_db, jobs=0)


def test_a_folder_with_broken_clips_among_good(
    puppet_corpus: Path, face_models: FaceModels, tmp_path: Path, portrait: np.ndarray
) -> None:
    folder = tmp_path / "corpus"
    shutil.copytree(puppet_corpus, folder)
    good = sorted(p.stem for p in folder.glob("*.mp4"))
    (folder / "noise.mp4").write_bytes(np.random.default_rng(0).bytes(3000))
    shutil.copy(folder / f"{good[0]}.mp4", folder / "wordless.mp4")
    told: list[tuple[str, int, int]] = []
    report = doctor_report(folder, jobs=1, advice=3, progress=lambda *a: told.append(a))
    assert not report.built
    assert [c.name for c in report.usable] == good
    reasons = {c.name: c.error for c in report.skipped}
    assert set(reasons) == {"noise", "wordless"}
    assert "cannot be read as video" in reasons["noise"]
    assert "has no words; put wordless.txt" in reasons["wordless"]
    for c in report.usable:
        assert c.looked == c.faces == 6 and len(c.rotations) == 6
        assert c.phonemes is not None and c.words
        assert c.mouth_pixels > 10 and c.sharpness > 0 and c.sound is not None
    assert np.abs(np.median(report.rotations, axis=0)).max() < 15
    assert told[-1] == ("looking at clips", len(good) + 2, len(good) + 2)
    assert "only once a database is built" in str(report.quality)
    page = _checked(doctor_page(report))
    assert "has no words; put wordless.txt" in page.text
    assert page.all("src"), "the rejected clip's picture"
    assert doctor_report(folder, jobs=1, limit=2).clips[0].name == report.clips[0].name


def test_why_quality_cannot_be_tested_is_told(makedb: ModuleType, tmp_path: Path) -> None:
    path = makedb.make_database(tmp_path / "guided.h5", guided=True)
    # Its settings are no settings: the rest of the report stands.
    assert "its settings: 'weights' must hold" in str(doctor_report(path, advice=0).quality)
    store_selection(path, settings_for("mixed").as_json())
    # Six clips cannot fit a guide again.
    assert "too few clips are left to fit the guide" in str(doctor_report(path, advice=0).quality)
    few = makedb.make_database(tmp_path / "few.h5", sequences=3, missing_in=None)
    report = doctor_report(few, advice=0)
    assert report.quality == "3 clips are too few to test one against the others"
    assert "Nothing is missing" not in doctor_page(report)
