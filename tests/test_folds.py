"""Evaluation on folds: the database's own sentences, without their own units and guides."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from analysis.guide import GuideClip, GuideSettings, fit_guides
from database.errors import SelectionError
from database.guide_model import mouth_parameters
from database.pictures import encode
from database.reader import UnitDatabase, open_database
from database.writer import write_database
from unitsel.likeness.evaluation import Evaluation, Evaluator
from unitsel.likeness.folds import evaluate_folds, guides_without
from unitsel.settings import TARGETS, SelectionSettings, TargetSettings

QUICK = GuideSettings(fewest_clips=3, hidden=16, members=1, epochs=4, steps=80, held_back=3)
REFERENCES = ("random", "phoneme_mean", "nearest")


def clips_of(database: UnitDatabase) -> list[GuideClip]:
    """The database's clips, with a sound that tells the mouth height."""
    units = database.units
    parameters = mouth_parameters(units)
    clips = []
    for s in range(len(database.sequences)):
        mine = units.sequence == s
        times = (units.frame[mine] + 0.5) / database.fps
        height = np.interp(np.arange(300) / 100, times, units.mouth_height[mine]) / 10
        heard = np.repeat(height[:, None], 26, axis=1).astype(np.float16)
        clips.append(GuideClip(database.sequence_track(s), times, parameters[mine], heard))
    return clips


@pytest.fixture(scope="module")
def guided(makedb: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small database with guides, whose last clip has no sound."""
    folder = tmp_path_factory.mktemp("folds")
    with open_database(
        makedb.make_database(folder / "plain.h5", sequences=8, frames=60, seed=5)
    ) as database:
        clips = clips_of(database)
    clips[-1] = replace(clips[-1], sound=np.zeros((0, 26), np.float16))
    content, pictures, landmarks = makedb.make_content(sequences=8, frames=60, seed=5)
    content = replace(
        content,
        guides=fit_guides(clips, QUICK),
        sound=tuple(c.sound for c in clips),
        settings={**content.settings, "guide": asdict(QUICK)},
    )
    write_database(folder / "guided.h5", content, (encode(p, "png") for p in pictures), landmarks)
    return folder / "guided.h5"


@pytest.fixture(scope="module")
def found(guided: Path) -> Evaluation:
    with open_database(guided) as database:
        return evaluate_folds(database, 2, methods=["all"])


def test_every_sentence_is_selected_by_every_target_cost(found: Evaluation) -> None:
    assert [s.clip for s in found.sentences] == [f"clip{i:02d}" for i in range(8)]
    assert found.skipped == () and found.folds == 2
    first, last = found.sentences[0], found.sentences[-1]
    with_sound = ["selected", *TARGETS, *REFERENCES, "prediction", "prediction_sound", "real"]
    assert list(first.scores) == with_sound
    # Without sound there is nothing for the guide that hears.
    assert list(last.scores) == [m for m in with_sound if "sound" not in m]
    assert list(found.means) == with_sound
    assert found.means["mixed"] == found.means["selected"]
    assert found.settings.target.name == "mixed"
    assert json.loads(json.dumps(found.as_json(), allow_nan=False))["folds"] == 2


def test_predictions_have_no_units_to_count(found: Evaluation) -> None:
    for method in ("prediction", "prediction_sound"):
        scores = found.means[method]
        assert 0.2 < scores.r_h < 1 and scores.sd_ratio > 0
        for name in ("r_h_mesh", "sl_avg", "tc_avg", "vc_avg", "closure_hits", "join_jump"):
            assert getattr(scores, name) is None
        assert scores.silence_ratio is not None


def test_no_selection_is_its_own_recording(found: Evaluation) -> None:
    for s in found.sentences:
        for method in ("selected", "paper", "nearest"):
            assert not np.allclose(s.made[method].pca, s.real.pca)
        assert s.scores["nearest"].r_pca_speech < 1 - 1e-6


def test_guides_of_a_fold_have_not_seen_it(guided: Path) -> None:
    with open_database(guided) as database:
        whole = guides_without(database, [], ["phonemes"])["phonemes"]
        clips = clips_of(database)
        alone = fit_guides([replace(c, sound=None) for c in clips[2:]], QUICK)["phonemes"]
        without = guides_without(database, [0, 1], ["phonemes"])["phonemes"]
        stored = database.guide("phonemes")
    assert np.array_equal(whole.hidden, stored.hidden)
    assert np.array_equal(without.hidden, alone.hidden)
    assert without.hidden.shape != whole.hidden.shape or not np.array_equal(
        without.hidden, whole.hidden
    )


def test_a_fold_is_predicted_by_its_own_guide(guided: Path, found: Evaluation) -> None:
    with open_database(guided) as database:
        # Folds are dealt in turn: sequence 3 lies in the second with 1, 5 and 7.
        guides = guides_without(database, [1, 3, 5, 7], ["phonemes", "sound"])
        evaluator = Evaluator(database, methods=["all"])
        target = evaluator.recorded(3)
        mine = evaluator.with_guides(guides).compare(target, [3])
        seen = evaluator.compare(target, [3])
    for method in ("prediction", "prediction_sound", "guided"):
        scores = found.sentences[3].scores[method]
        assert mine.scores[method].r_pca == pytest.approx(scores.r_pca, abs=1e-5)
    apart = seen.scores["prediction"].r_pca - mine.scores["prediction"].r_pca
    assert abs(apart) > 1e-3
    assert seen.scores["paper"] == mine.scores["paper"]


def test_the_result_does_not_depend_on_jobs(guided: Path, found: Evaluation) -> None:
    with open_database(guided) as database:
        again = evaluate_folds(database, 2, methods=["all"], jobs=2)
    assert again.as_json() == found.as_json()


def test_a_limit_takes_sentences_evenly(guided: Path, found: Evaluation) -> None:
    told: list[tuple[str, int, int]] = []
    with open_database(guided) as database:
        few = evaluate_folds(
            database,
            2,
            settings=SelectionSettings(target=TargetSettings("paper")),
            limit=3,
            progress=lambda *step: told.append(step),
        )
    assert [s.clip for s in few.sentences] == ["clip00", "clip04", "clip07"]
    assert list(few.means) == ["selected", *REFERENCES, "prediction", "real"]
    assert told[-1] == ("evaluating", 3, 3)


def test_a_clip_without_sound_is_skipped_where_sound_is_chosen(guided: Path) -> None:
    sound = SelectionSettings(target=TargetSettings("sound"))
    with open_database(guided) as database:
        heard = evaluate_folds(database, 2, settings=sound)
    assert len(heard.sentences) == 7
    ((clip, reason),) = heard.skipped
    assert clip == "clip07" and "has no sound" in reason


def test_folds_that_cannot_be_made(guided: Path, small_db: Path) -> None:
    with open_database(guided) as database:
        for folds in (0, 1, 9):
            with pytest.raises(SelectionError, match=f"8 sequences cannot be dealt into {folds}"):
                evaluate_folds(database, folds)
        # Three clips are the fewest that guides are fitted from here.
        with pytest.raises(SelectionError, match="too few clips are left"):
            guides_without(database, range(6), ["phonemes"])
    with (
        open_database(small_db) as database,
        pytest.raises(SelectionError, match="'mixed' needs a guide from phonemes"),
    ):
        evaluate_folds(database, 2, settings=SelectionSettings())
