"""A portrait's file, its adjustments, and the API that it shares with databases."""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

import unitsel
from analysis.portrait_adjust import Adjustment, Drag, adjust, dragged, read_adjustment
from database.errors import DatabaseError, FaceError, RenderError, SelectionError
from database.heads import open_portrait
from database.media import probe, read_video
from database.portrait_file import PortraitHead
from database.portrait_mesh import FRAME, MESH_INDEX, MOUTH_CORNERS, OUTER_LIPS
from database.portrait_schema import PORTRAIT_FIELDS
from database.track import Interval, PhonemeTrack


@pytest.fixture(scope="module")
def head(portrait_head: Path) -> Iterator[PortraitHead]:
    with open_portrait(portrait_head) as opened:
        yield opened


@pytest.fixture
def track() -> PhonemeTrack:
    spans = [("sil", 0.1), ("m", 0.1), ("aa", 0.2), ("m", 0.1), ("sil", 0.1)]
    ends = np.cumsum([length for _, length in spans])
    return PhonemeTrack.from_intervals(
        [Interval(e - length, e, p) for (p, length), e in zip(spans, ends, strict=True)], name="ma"
    )


def test_it_comes_back_as_it_went(head: PortraitHead, portrait: np.ndarray) -> None:
    np.testing.assert_array_equal(head.photo, portrait[:600, :512])
    assert (head.mask.width, head.mask.height) == (512, 600)
    assert head.mask.folded() == 0
    assert head.settings["photo"].endswith("grace_hopper.jpg")
    assert head.report["notes"] == []
    assert pickle.loads(pickle.dumps(head)).identity == head.identity


def test_every_field_has_a_checksum(portrait_head: Path) -> None:
    with h5py.File(portrait_head) as file:
        for field in PORTRAIT_FIELDS:
            assert file[field.path].fletcher32, field.path


def test_a_flipped_bit_is_refused(portrait_head: Path, tmp_path: Path) -> None:
    data = bytearray(portrait_head.read_bytes())
    data[len(data) // 2] ^= 4
    (tmp_path / "x.h5").write_bytes(data)
    with (
        pytest.raises(DatabaseError, match="damaged"),
        unitsel.open_head(tmp_path / "x.h5") as damaged,
    ):
        assert isinstance(damaged, PortraitHead)
        _ = damaged.photo


def test_open_head_opens_both_kinds(portrait_head: Path, small_db: Path, tmp_path: Path) -> None:
    with unitsel.open_head(portrait_head) as one, unitsel.open_head(small_db) as other:
        assert isinstance(one, PortraitHead) and isinstance(other, unitsel.UnitDatabase)
        with pytest.raises(SelectionError, match="DriveSettings"):
            unitsel.synthesizer_of(one, unitsel.SelectionSettings())  # type: ignore[call-overload]
        with pytest.raises(SelectionError, match="footage"):
            unitsel.synthesizer_of(other, unitsel.DriveSettings())  # type: ignore[call-overload]
    with pytest.raises(DatabaseError, match=r"is a portrait's head.*unitsel build"):
        unitsel.open_database(portrait_head)
    with pytest.raises(DatabaseError, match=r"is a database of units.*unitsel portrait"):
        open_portrait(small_db)
    with pytest.raises(DatabaseError, match="no such file"):
        unitsel.open_head(tmp_path / "none.h5")


def test_the_mouth_corners_are_where_a_person_sees_them(head: PortraitHead) -> None:
    seen = np.array([(230.5, 276.5), (306.0, 272.0)])
    assert np.linalg.norm(head.mask.vertices[MOUTH_CORNERS] - seen, axis=1).max() < 5


def test_dragging_pulls_what_is_near(head: PortraitHead) -> None:
    before, unit = head.mask.vertices, head.mask.unit
    corner = before[OUTER_LIPS[0]]
    drag = Drag(tuple(corner), (corner[0] - 8, corner[1] + 2), 0.25)
    after = dragged(before, drag, unit)
    by = np.linalg.norm(after - before, axis=1)
    away = np.linalg.norm(before - corner, axis=1) / unit
    assert by[OUTER_LIPS[0]] == pytest.approx(np.hypot(8, 2))
    assert (by[away > 0.25] == 0).all() and (np.diff(by[np.argsort(away)]) < 1e-9).all()
    alone = dragged(before, Drag(tuple(corner), (0.0, 0.0), 0.0), unit)
    assert (alone != before).any(axis=1).sum() == 1


def test_a_box_moves_the_face_and_not_the_frame(head: PortraitHead) -> None:
    face = head.mask.vertices[MESH_INDEX >= 0]
    low, high = face.min(axis=0), face.max(axis=0)
    box = (*(low - 3), *(high + 5))
    changed = adjust(head.mask, Adjustment(box=box)).vertices
    now = changed[MESH_INDEX >= 0]
    np.testing.assert_allclose([*now.min(axis=0), *now.max(axis=0)], box)
    np.testing.assert_array_equal(changed[FRAME], head.mask.vertices[FRAME])


def test_an_adjustment_that_folds_the_mask_is_refused(head: PortraitHead) -> None:
    start = head.mask.vertices[OUTER_LIPS[5]]
    far = Adjustment(drags=(Drag(tuple(start), (start[0], start[1] + 200), 0.3),))
    with pytest.raises(FaceError, match="turns"):
        adjust(head.mask, far)


def test_adjustments_are_read(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text(
        json.dumps(
            {
                "box": [1, 2, 3, 4.5],
                "vertices": {"12": [5, 6]},
                "drags": [{"from": [1, 2], "to": [3, 4], "reach": 0.1}],
            }
        )
    )
    found = read_adjustment(file)
    assert found == Adjustment(
        (1.0, 2.0, 3.0, 4.5), {12: (5.0, 6.0)}, (Drag((1.0, 2.0), (3.0, 4.0), 0.1),)
    )
    for bad in ('[]', '{"boxes": 1}', '{"box": [1, 2, 3]}', '{"box": [3, 2, 1, 4]}', "{",
                '{"vertices": {"900": [1, 2]}}', '{"drags": [{"from": [1, 2]}]}',
                '{"drags": [{"from": [1, 2], "to": [1, 2], "reach": -1}]}'):  # fmt: skip
        file.write_text(bad)
        with pytest.raises(FaceError) as error:
            read_adjustment(file)
        assert str(file) in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(FaceError, match="cannot be read"):
        read_adjustment(tmp_path / "none.json")


def test_it_is_selected_rendered_streamed_and_written_as_a_database_is(
    head: PortraitHead, track: PhonemeTrack, tmp_path: Path
) -> None:
    synthesizer = unitsel.synthesizer_of(head)
    performance = synthesizer.select(track)
    frames = list(synthesizer.render(performance, fps=25))
    assert len(frames) == 15 and frames[0].y.shape == (600, 512)
    streamed = list(synthesizer.stream([track, track], fps=25, size=(256, 300)))
    assert len(streamed) == 30
    assert [f.utterance.index for f in streamed] == [0] * 15 + [1] * 15
    written = synthesizer.write(performance, tmp_path / "o.mp4", fps=25)
    assert written.frames == 15 and probe(tmp_path / "o.mp4").width == 512
    with pytest.raises(RenderError, match="background"):
        synthesizer.write(performance, tmp_path / "p.mp4", background="x.mp4")
    with pytest.raises(RenderError, match="of its shape"):
        next(iter(synthesizer.render(performance, size=(300, 300))))
    assert not (tmp_path / "p.mp4").exists()


def test_the_mouth_opens_for_a_and_closes_for_m(
    head: PortraitHead, track: PhonemeTrack, tmp_path: Path
) -> None:
    settings = unitsel.DriveSettings(still=True)
    synthesizer = unitsel.synthesizer_of(head, settings)
    synthesizer.write(synthesizer.select(track), tmp_path / "o.mp4", fps=50)
    pictures = [f.rgb.astype(float).mean(axis=2) for f in read_video(tmp_path / "o.mp4")]
    x, y = np.rint(head.mask.vertices[OUTER_LIPS].mean(axis=0)).astype(int)
    change = [np.abs(p[y - 12 : y + 20, x - 20 : x + 20] - pictures[0][
        y - 12 : y + 20, x - 20 : x + 20]).mean() for p in pictures]  # fmt: skip
    assert max(change[10:20]) > 4 * max(change[7], change[23], 1.0)
    above = [np.abs(p[:200] - pictures[0][:200]).mean() for p in pictures]
    assert max(above) < 1.0, "with `still` nothing else moves"
