"""Evaluation: the puppet's database against clips of the puppet that it does not hold."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from analysis.corpus import find_clips
from analysis.face import FaceModels
from database.errors import CorpusError, SelectionError
from database.reader import UnitDatabase, open_database
from database.timing import Timing, write_timing
from database.track import frame_times
from unitsel.costs import Weights
from unitsel.likeness.evaluation import Evaluation, Evaluator, Scores, evaluate
from unitsel.likeness.eye_measures import (
    closed_frames,
    closure_hit_rate,
    greatest_join_jump,
    lip_opening,
    natural_step,
    silence_motion,
)
from unitsel.select import select_path, target_graph
from unitsel.settings import SelectionSettings, TargetSettings, settings_for

PAPER = TargetSettings("paper")


@pytest.fixture(scope="module")
def database(puppet_db: Path) -> Iterator[UnitDatabase]:
    """Open the puppet's database."""
    with open_database(puppet_db) as opened:
        yield opened


@pytest.fixture(scope="module")
def unseen(
    puppet: ModuleType, puppet_corpus: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Two clips that the database lacks, and between them one that it holds."""
    folder = tmp_path_factory.mktemp("unseen")
    for seed, (name, said) in enumerate(
        {"a1": "bin green at m five now", "c3": "lay white with x two"}.items(), 40
    ):
        track, words = puppet.even_track(said, 0.2, 1.2)
        puppet.write_clip(folder / f"{name}.mp4", track, puppet.hum(track), seed)
        write_timing(folder / f"{name}.TextGrid", Timing(track, words))
    for extension in ("mp4", "TextGrid"):
        (folder / f"b2.{extension}").write_bytes(
            (puppet_corpus / f"hopper2.{extension}").read_bytes()
        )
    return folder


@pytest.fixture(scope="module")
def found(database: UnitDatabase, unseen: Path, face_models: FaceModels) -> Evaluation:
    return evaluate(database, unseen)


def test_a_clip_of_the_database_is_left_out_and_named(found: Evaluation) -> None:
    assert [s.clip for s in found.sentences] == ["a1", "c3"]
    ((clip, reason),) = found.skipped
    assert clip == "b2"
    assert "is part of the database" in reason and "--exclude b2" in reason


def test_a_folder_of_known_clips_is_refused(
    database: UnitDatabase, puppet_corpus: Path, face_models: FaceModels
) -> None:
    with pytest.raises(CorpusError, match=r"is part of the database.*--exclude hopper1"):
        evaluate(database, puppet_corpus, limit=1)


def test_the_references_bound_the_selection(found: Evaluation) -> None:
    means = found.means
    assert list(means) == ["selected", "random", "phoneme_mean", "nearest", "real"]
    assert means["nearest"].r_pca >= means["selected"].r_pca > means["random"].r_pca
    assert means["nearest"].r_pca_speech >= means["selected"].r_pca_speech
    assert means["selected"].r_h_speech > 0.5
    assert means["selected"].sl_avg > means["random"].sl_avg
    assert means["selected"].vc_avg < means["random"].vc_avg
    assert means["selected"].tc_avg < means["random"].tc_avg
    assert means["nearest"].r_h_mesh >= means["phoneme_mean"].r_h_mesh > means["random"].r_h_mesh
    assert means["selected"].join_jump < means["random"].join_jump
    assert means["selected"].silence_ratio < means["random"].silence_ratio
    for costs in ("sl_avg", "tc_avg", "vc_avg", "join_jump"):
        assert getattr(means["phoneme_mean"], costs) is None
        assert getattr(means["real"], costs) is None
    # Means of phonemes move less than mouths do.
    assert means["phoneme_mean"].sd_ratio < 1


def test_correlations_are_those_of_the_trajectories(found: Evaluation) -> None:
    for s in found.sentences:
        assert len(s.seconds) == len(s.inside) == len(s.real.pca)
        assert [*s.made, "real"] == list(s.scores)
        for method in s.made:
            made, scores = s.made[method], s.scores[method]
            assert scores.r_pca == pytest.approx(np.corrcoef(made.pca, s.real.pca)[0, 1])
            inside = np.corrcoef(made.height[s.inside], s.real.height[s.inside])[0, 1]
            assert scores.r_h_speech == pytest.approx(inside)
            ratio = made.height[s.inside].std() / s.real.height[s.inside].std()
            assert scores.sd_ratio == pytest.approx(ratio)


def test_the_recording_is_a_row_of_its_own(found: Evaluation) -> None:
    for s in found.sentences:
        real = s.scores["real"]
        assert (real.r_pca, real.r_h_speech, real.sd_ratio) == pytest.approx((1, 1, 1))
        assert real.silence_ratio == 1
        # "lay white with x two" has no p, b or m to close the lips for.
        assert (real.closure_hits is None) == (s.clip == "c3")
        for made in (s.scores["selected"], s.scores["nearest"]):
            assert made.silence_sd is not None and real.silence_sd is not None
            assert made.silence_ratio == pytest.approx(made.silence_sd / real.silence_sd)


def test_what_the_eye_punishes_is_measured_on_the_compared_frames(
    database: UnitDatabase,
) -> None:
    """By hand, from what the database holds: the same figures as in the scores."""
    evaluator = Evaluator(database, SelectionSettings(target=PAPER))
    target = evaluator.recorded(0)
    units, fps = database.units, database.fps
    own = np.flatnonzero(units.sequence == 0)
    opening = lip_opening(database.landmarks(own))
    assert np.allclose(target.opening, opening)
    sentence = evaluator.compare(target, [0])
    closed = closed_frames(opening, target.frames, evaluator.rulers.closed_at, fps)
    hits = closure_hit_rate(closed, target.frames, target.track, fps)
    assert sentence.scores["real"].closure_hits == hits
    motion = silence_motion(units.mouth_height[own], target.frames, target.track, fps)
    assert motion is not None
    assert sentence.scores["real"].silence_sd == pytest.approx(motion.sd)
    assert sentence.scores["real"].silence_step == pytest.approx(motion.step)
    graph = target_graph(evaluator.source, target.track, [0])
    path = select_path(evaluator.source, graph, evaluator.settings.weights).units
    jump = greatest_join_jump(
        units.pca[path],
        units.sequence[path],
        units.frame[path],
        natural_step(units.pca, units.sequence, units.frame),
    )
    assert sentence.scores["selected"].join_jump == pytest.approx(jump)


def test_means_are_of_the_sentences(found: Evaluation) -> None:
    for method, mean in found.means.items():
        for name in (f.name for f in fields(Scores)):
            values = [getattr(s.scores[method], name) for s in found.sentences]
            there = [v for v in values if v is not None]
            expected = np.mean(there) if there else None
            if name == "silence_ratio" and expected is not None:
                # The ratio of the means, not the mean of the ratios.
                still = np.mean([s.scores["real"].silence_sd for s in found.sentences])
                expected = mean.silence_sd / still
            assert getattr(mean, name) == (expected and pytest.approx(expected))


def test_the_document_is_json_without_nan(found: Evaluation) -> None:
    document = found.as_json()
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert document["skipped"][0]["clip"] == "b2"
    assert len(document["sentences"]) == 2
    assert document["folds"] is None
    assert SelectionSettings.from_json(document["settings"]) == found.settings
    assert found.settings.target.name == "paper"


def test_a_sequence_selected_for_itself_is_itself(
    database: UnitDatabase, puppet_corpus: Path, face_models: FaceModels
) -> None:
    """With the clip's own units allowed and skips dear, the selection is the recording."""
    evaluator = Evaluator(database, SelectionSettings(Weights(skip=1e6), target=PAPER))
    name = database.sequences.name[1]
    clip = next(c for c in find_clips(puppet_corpus) if c.name == name)
    target = evaluator.target(clip)
    own = np.flatnonzero(database.units.sequence == 1)
    assert np.allclose(target.pca, database.units.pca[own], atol=1e-2)
    assert np.allclose(target.height, database.units.mouth_height[own], atol=1e-3)
    stored = evaluator.recorded(1)
    assert (stored.clip, stored.words) == (name, target.words)
    assert np.array_equal(stored.frames, target.frames)
    for parameter in ("mesh", "opening"):
        assert np.allclose(getattr(stored, parameter), getattr(target, parameter), atol=1e-4)
    sentence = evaluator.compare(target)
    assert np.allclose(sentence.seconds, frame_times(len(own), database.fps))
    for method in ("selected", "nearest"):
        scores = sentence.scores[method]
        for value in (
            *(scores.r_pca, scores.r_h, scores.r_pca_speech, scores.r_h_speech),
            *(scores.r_h_mesh, scores.sd_ratio, scores.sd_ratio_pca),
        ):
            assert value == pytest.approx(1, abs=1e-4), method
    assert sentence.scores["selected"].tc_avg == pytest.approx(0, abs=1e-6)
    assert sentence.scores["selected"].vc_avg == 0
    assert sentence.scores["selected"].join_jump == 0
    assert sentence.scores["selected"].closure_hits == sentence.scores["real"].closure_hits
    assert sentence.scores["selected"].sl_avg == len(own)

    # Without its own units neither can be perfect, and the nearest is no longer its own.
    without = evaluator.compare(target, exclude_sequences=[name])
    assert without.scores["nearest"].r_pca < 1 - 1e-4
    assert without.scores["selected"].r_pca < without.scores["nearest"].r_pca


def test_target_costs_that_need_a_guide(database: UnitDatabase) -> None:
    with pytest.raises(SelectionError, match=r"'guided' needs a guide from phonemes.*'paper'"):
        Evaluator(database, SelectionSettings(target=TargetSettings("guided")))
    with pytest.raises(SelectionError, match="'sound' needs a guide from sound"):
        Evaluator(database, methods=["sound"])
    with pytest.raises(SelectionError, match="'papre' is no target cost"):
        Evaluator(database, methods=["papre"])
    everything = Evaluator(database, methods=["all"]).compared
    assert list(everything) == ["selected", "paper"]
    assert everything["paper"] == everything["selected"] == settings_for("paper")
