"""From footage to a video, against the truth: clips of a portrait that espeak speaks for.

What was drawn is known to a fraction of a pixel (`portrait_corpus.py`), so that `build` can be held
to it without any footage: poses, lips and phones; then a sentence is selected without its own clip
and rendered, and its mouths are compared with those that were drawn.
"""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest

from analysis.build import build_database
from analysis.build_settings import BuildSettings
from analysis.corpus_lips import LipSettings
from analysis.face import FaceFinder
from analysis.lips import mesh_mouth_height
from analysis.models import FaceModels
from analysis.portrait import portrait_of
from database.heads import open_portrait
from database.mask import OUTER_LIPS, Camera, Poses, project
from database.media import read_video
from database.phonemes import CLOSURES, SILENCE, VISEME_OF
from database.pinyin import TimedSyllable
from database.portrait_file import write_portrait
from database.portrait_mesh import NOSE
from database.reader import UnitDatabase, open_database
from database.track import PhonemeTrack
from unitsel.portrait.driver import DriveSettings, drive
from unitsel.portrait.life import LifeSettings
from unitsel.portrait.living import living_still
from unitsel.portrait.synthesizer import PortraitSynthesizer
from unitsel.synthesizer import Synthesizer

HEAD = [33, 263, 168, 6, 1]
"""Vertices of the face mesh that the mouth does not move: eye corners and nose."""


@pytest.fixture(scope="module")
def made(
    portrait_corpus: ModuleType, face_models: FaceModels, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, Any]]:
    pytest.importorskip("espeakng_loader", reason="needs the optional extra `espeak`")
    folder = tmp_path_factory.mktemp("grace")
    return folder, portrait_corpus.make_corpus_apart(folder)


@pytest.fixture(scope="module")
def truths(made: tuple[Path, dict[str, Any]]) -> dict[str, Any]:
    return made[1]


@pytest.fixture(scope="module")
def database(
    made: tuple[Path, dict[str, Any]], tmp_path_factory: pytest.TempPathFactory
) -> UnitDatabase:
    path = tmp_path_factory.mktemp("built") / "grace.h5"
    settings = BuildSettings(lips=LipSettings(source="mesh-only"))
    report = build_database(made[0], path, settings=settings, jobs=1)
    assert report.skipped == () and report.repaired == () and report.sequences == len(made[1])
    return open_database(path)


def of_clips(database: UnitDatabase, truths: dict[str, Any], name: str) -> np.ndarray:
    """A truth of every unit."""
    units, names = database.units, database.sequences.name
    parts = [
        getattr(truths[n], name)[units.frame[units.sequence == s]] for s, n in enumerate(names)
    ]
    return np.concatenate(parts)


def test_every_frame_is_a_unit_with_its_phoneme(
    database: UnitDatabase, truths: dict[str, Any], portrait_corpus: ModuleType
) -> None:
    assert len(database) == sum(len(t.maps) for t in truths.values())
    for s, name in enumerate(database.sequences.name):
        mine = database.units.sequence == s
        said = truths[name].track.sample(portrait_corpus.FPS, int(mine.sum()))
        np.testing.assert_array_equal(database.units.phoneme[mine], said)


def test_poses_are_those_that_were_filmed(database: UnitDatabase, truths: dict[str, Any]) -> None:
    """The head's points, as poses put them, stand still once the known motion is taken out."""
    units = database.units
    points = database.mask.vertices[HEAD]
    for s, name in enumerate(database.sequences.name):
        mine = np.flatnonzero(units.sequence == s)
        maps = truths[name].maps[units.frame[mine]]
        poses = Poses(units.rotation[mine], units.translation[mine])
        back = []
        for i, turn in enumerate(maps):
            inverse = cv2.invertAffineTransform(turn)
            seen = project(points, poses.matrix(i), database.camera)
            back.append(seen @ inverse[:, :2].T + inverse[:, 2])
        off = np.array(back) - np.mean(back, axis=0)
        # Measured: 0.06 px of some 4 px of motion, 0.013 degrees of 1.5, 0.04 % of 1.3 %.
        assert np.sqrt((off**2).sum(axis=2).mean()) < 0.15
        roll = units.rotation[mine, 2] - np.arctan2(maps[:, 1, 0], maps[:, 0, 0])
        assert np.degrees(roll.std()) < 0.04
        distance = units.translation[mine, 2] * np.hypot(maps[:, 1, 0], maps[:, 0, 0])
        assert distance.std() / distance.mean() < 0.0012
        assert np.degrees(units.rotation[mine, :2].std(axis=0)).max() < 0.5, "none was filmed"


def test_lips_are_those_that_were_drawn(database: UnitDatabase, truths: dict[str, Any]) -> None:
    """The face mesh sees less than there is, and sees it at the right time."""
    units = database.units
    width = of_clips(database, truths, "width")
    size = float(np.median(units.mouth_width) / np.median(width))
    # Measured: r 0.92, 0.95 and 0.5 to 0.7; 2.2, 3.4 and 2.0 % of the mouth's width.
    for name, found, least in (
        ("height", units.mouth_height, 0.85),
        ("opening", units.inner_opening, 0.88),
        ("width", units.mouth_width, 0.3),
    ):
        drawn = size * of_clips(database, truths, name)
        assert np.corrcoef(drawn, found)[0, 1] > least, name
        off = np.abs(drawn - found - np.median(drawn - found))
        assert np.median(off) < 0.055 * size * np.median(width), name
    # Point by point, as the mesh has them in the frames: 3.4 % of the width in the median.
    found = database.landmarks(slice(None))[:, list(OUTER_LIPS)]
    off = np.linalg.norm(found - of_clips(database, truths, "lips"), axis=2)
    assert np.median(off) < 0.06 * np.median(width)
    closed = np.isin(units.phoneme, list(CLOSURES))
    vowels = np.isin(VISEME_OF[units.phoneme], np.arange(1, 12))
    assert of_clips(database, truths, "opening")[closed].max() < 0.5, "pixels"
    assert np.median(units.inner_opening[vowels]) > 2 * np.median(units.inner_opening[closed])


def test_selected_mouths_are_like_those_that_were_drawn(
    database: UnitDatabase, truths: dict[str, Any]
) -> None:
    synthesizer = Synthesizer(database)
    opening = of_clips(database, truths, "opening")
    likeness = []
    for s, name in enumerate(database.sequences.name):
        truth = truths[name]
        chosen = synthesizer.select(truth.track, exclude_sequences=[s]).units
        assert (database.units.sequence[chosen] != s).all()
        likeness.append(np.corrcoef(opening[chosen], truth.opening[: len(chosen)])[0, 1])
    # Measured: 0.85 to 0.92, of three other sentences.
    assert min(likeness) > 0.65 and np.mean(likeness) > 0.75


def test_a_rendered_sentence_opens_and_shuts_as_it_should(
    made: tuple[Path, dict[str, Any]],
    database: UnitDatabase,
    face_models: FaceModels,
    tmp_path: Path,
) -> None:
    folder, truths = made
    name = database.sequences.name[0]
    synthesizer = Synthesizer(database)
    selection = synthesizer.select(truths[name].track, exclude_sequences=[0])
    written = synthesizer.write(
        selection,
        tmp_path / "said.mp4",
        audio=folder / f"{name}.mp4",
        background=folder / f"{database.sequences.name[1]}.mp4",
    )
    finder = FaceFinder(face_models)
    meshes = [finder.find(f.rgb) for f in read_video(written.path)]
    assert len(meshes) == len(truths[name].opening) and all(m is not None for m in meshes)
    height = mesh_mouth_height(np.stack([m.points[:, :2] for m in meshes if m is not None]))
    assert np.corrcoef(height, truths[name].height)[0, 1] > 0.6


def test_a_photo_can_live_behind_a_mouth(
    database: UnitDatabase, face_models: FaceModels, portrait: np.ndarray, tmp_path: Path
) -> None:
    """The video of a photo has a head whose tracked pose is the motion that it was given."""
    photo, video = tmp_path / "grace.png", tmp_path / "alive.mp4"
    cv2.imwrite(str(photo), portrait[..., ::-1])
    settings = DriveSettings(life=LifeSettings(turn=3.0, shift=0.02, perturbation=0.0))
    seen: list[str] = []
    done = living_still(
        photo, video, 1.2, settings=settings, progress=lambda stage, i, n: seen.append(stage)
    )
    assert done == len(seen) == 30
    background = Synthesizer(database).background(video)
    assert len(background) == 30
    poses = background.poses
    middle = np.array(
        [
            project(database.mask.vertices[HEAD], poses.matrix(i), _camera(database))
            for i in range(30)
        ]
    ).mean(axis=1)
    given = drive(portrait_of(photo).mask, _silence(1.2), 25.0, settings).displacements
    mask = portrait_of(photo).mask
    bridge = mask.to_pixels(given[:, NOSE[:2]]).mean(axis=1)
    off = (middle - middle.mean(axis=0)) - (bridge - bridge.mean(axis=0))
    assert bridge.std(axis=0).max() > 1.0, "pixels that it moved"
    assert np.abs(off).max() < 1.0
    frames = [f.rgb.astype(int) for f in read_video(video)]
    corner = np.s_[:60, :60]
    assert np.abs(frames[0][corner] - frames[-1][corner]).mean() < 3, "the background stays"


def test_syllables_go_with_their_utterances(
    face_models: FaceModels, portrait: np.ndarray, tmp_path: Path
) -> None:
    """A long Mandarin text is shown utterance by utterance, each with its own syllables."""
    photo, head = tmp_path / "grace.png", tmp_path / "grace.h5"
    cv2.imwrite(str(photo), portrait[::2, ::2, ::-1])
    write_portrait(head, portrait_of(photo))
    syllables = [
        TimedSyllable(0.1, 0.3, "ma", 1, 0.17),
        TimedSyllable(0.5, 0.7, "bu", 4, 0.56),
        TimedSyllable(0.7, 0.8, "e", 4, 0.7),
    ]
    with open_portrait(head) as opened:
        frames = list(
            PortraitSynthesizer(opened).stream(
                [_silence(0.4), _silence(0.6)], fps=25, syllables=syllables
            )
        )
    assert [f.index for f in frames] == list(range(25))
    first, last = frames[0].utterance.selection, frames[-1].utterance.selection
    assert [s.pinyin for s in first.syllables] == ["ma"]
    assert [s.pinyin for s in last.syllables] == ["bu", "e"]
    assert [s.start for s in last.syllables] == pytest.approx([0.1, 0.3])
    assert last.syllables[0].onset == pytest.approx(0.16)


def _camera(database: UnitDatabase) -> Camera:
    return database.camera.scaled_to(512, 600)


def _silence(seconds: float) -> PhonemeTrack:
    return PhonemeTrack(np.array([SILENCE]), np.array([0.0, seconds]))
