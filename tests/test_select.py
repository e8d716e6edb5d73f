"""Selection from small databases, from the track to the units."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from analysis.cost_model import fit_cost_model
from database.cost_definition import CostSettings
from database.errors import SelectionError
from database.phonemes import PHONEME_INDEX, PHONEMES, SILENCE, VISEME_OF
from database.schema import CostModel, PhoneMarks, Phones, Sequences, TextureModel, Units
from database.track import PhonemeTrack, context_frames, context_windows
from unitsel.costs import Weights
from unitsel.select import select_path, select_units, target_graph
from unitsel.settings import SelectionSettings, TargetSettings
from unitsel.source import SelectionInput

EIGENVALUES = np.geomspace(100, 1, 12).astype(np.float32)


@dataclass
class Source:
    """The part of a database that selection reads, in memory."""

    fps: float
    units: Units
    sequences: Sequences
    texture: TextureModel
    costs: CostModel
    phonemes: list
    phones: Phones
    marks: PhoneMarks = field(default_factory=PhoneMarks.none)
    guides: tuple[str, ...] = ()

    def guide(self, kind):
        raise AssertionError(f"no guide {kind} was promised")

    def context(self, n):
        return np.concatenate([context_windows(p, n) for p in self.phonemes])


def make_source(sentences, fps=25.0, seed=0):
    """Build a database of sentences: lists of (phoneme, frames)."""
    rng = np.random.default_rng(seed)
    tracks = [
        np.concatenate([np.full(n, PHONEME_INDEX[p], np.uint8) for p, n in s]) for s in sentences
    ]
    phoneme = np.concatenate(tracks)
    n = len(phoneme)
    looks = np.random.default_rng(99).normal(0, 10, (len(PHONEMES), 12))

    def drift(mean, scale):
        """Each clip's own level, and a slow walk from there, as recorded mouths have."""
        walks = [rng.normal() + np.cumsum(rng.normal(0, 0.05, len(t))) for t in tracks]
        return (mean + scale * np.concatenate(walks)).astype(np.float32)

    units = Units(
        sequence=np.repeat(np.arange(len(tracks)), [len(t) for t in tracks]).astype(np.int32),
        frame=np.concatenate([np.arange(len(t)) for t in tracks]).astype(np.int32),
        phoneme=phoneme,
        viseme=VISEME_OF[phoneme],
        pca=np.stack([drift(looks[phoneme, k], 3) for k in range(12)], axis=1),
        mouth_width=drift(50, 2),
        mouth_height=drift(15, 2),
        inner_opening=drift(3, 1),
        teeth=drift(0.5, 0.1),
        tongue=drift(0.3, 0.1),
        rotation=np.zeros((n, 3), np.float32),
        translation=np.zeros((n, 3), np.float32),
    )
    s = len(tracks)
    text = tuple(f"clip{i}" for i in range(s))
    count = np.array([len(t) for t in tracks], np.int32)
    sequences = Sequences(
        text, text, text, text, np.full(s, fps, np.float32), count,
        (np.cumsum(count) - count).astype(np.int32), count, np.zeros((s, 3, 1), np.float32),
    )  # fmt: skip
    nothing = np.zeros((0,), np.float32)
    texture = TextureModel(nothing, nothing, EIGENVALUES, nothing, nothing)
    contexts = np.concatenate([context_windows(t, context_frames(fps)) for t in tracks])
    costs = fit_cost_model(units, contexts, EIGENVALUES, fps)
    return Source(fps, units, sequences, texture, costs, tracks, phones_of(tracks, fps))


def phones_of(tracks, fps):
    """Give the phones of sentences of a phoneme a frame."""
    rows = []
    for s, track in enumerate(tracks):
        edges = np.flatnonzero(np.diff(track)) + 1
        bounds = itertools.pairwise([0, *edges, len(track)])
        rows += [(s, track[a], a / fps, b / fps) for a, b in bounds]
    sequence, phoneme, start, end = zip(*rows, strict=True)
    return Phones(
        np.array(sequence, np.int32),
        np.array(phoneme, np.uint8),
        np.array(start, np.float64),
        np.array(end, np.float64),
    )


def track_of(sentence, fps=25.0):
    phonemes = [PHONEME_INDEX[p] for p, _ in sentence]
    ends = np.cumsum([n for _, n in sentence]) / fps
    return PhonemeTrack(np.array(phonemes), np.concatenate([[0.0], ends]))


BIN = [("sil", 6), ("b", 3), ("ih", 4), ("n", 3), ("sil", 6)]
LAY = [("sil", 5), ("l", 3), ("ey", 6), ("sil", 7)]
SET = [("sil", 6), ("s", 4), ("eh", 4), ("t", 2), ("sil", 5)]


@pytest.fixture(scope="module")
def source():
    return make_source([BIN, LAY, SET])


@pytest.mark.parametrize("clip", [0, 1, 2])
def test_a_recorded_sentence_selects_itself(source, clip):
    selection = select_units(source, track_of([BIN, LAY, SET][clip]))
    start = source.sequences.first_unit[clip]
    assert selection.units.tolist() == list(range(start, start + source.sequences.units[clip]))
    assert selection.costs.target.max() == 0
    assert selection.costs.skip.max() == 0
    assert selection.fallbacks == ()
    assert selection.fps == 25


def test_units_have_the_wanted_visemes(source):
    track = track_of([("sil", 4), ("eh", 3), ("l", 2), ("d", 3), ("iy", 5), ("sil", 3)])
    selection = select_units(source, track)
    wanted = VISEME_OF[track.sample(25)]
    assert (source.units.viseme[selection.units] == wanted).all()
    assert selection.fallbacks == ()


def test_target_costs_are_scaled(source):
    track = track_of(BIN)
    graph = target_graph(SelectionInput.of(source), track)
    doubled = replace(source.costs, target_scale=2 * source.costs.target_scale)
    half = target_graph(SelectionInput.of(replace(source, costs=doubled)), track)
    for a, b in zip(graph.target, half.target, strict=True):
        assert a == pytest.approx(2 * b)


@pytest.mark.parametrize("exclude", [[0], ["clip0"], "clip0", {0}])
def test_excluded_sequences_are_not_used(source, exclude):
    selection = select_units(source, track_of(LAY), exclude_sequences=exclude)
    assert 0 not in source.units.sequence[selection.units]
    other = select_units(source, track_of(BIN), exclude_sequences=exclude)
    assert 0 not in source.units.sequence[other.units]
    # b and ih are in the excluded clip only.
    assert [PHONEMES[f.phoneme] for f in other.fallbacks] == ["ih", "b"]


def test_a_missing_viseme_falls_back_to_the_nearest_and_says_so():
    source = make_source([BIN, LAY, SET])
    m = np.full((43, 43), 9, np.float32)
    np.fill_diagonal(m, 0)
    w, ey, eh, uh, n, t = (PHONEME_INDEX[p] for p in ("w", "ey", "eh", "uh", "n", "t"))
    # Viseme 4 has ey and eh here and not uh, which must not count: their mean is 2.
    m[w, [ey, eh, uh]] = [1, 3, 100]
    # Viseme 19 has n and t: nearest by one phoneme, not by the mean, which is 3.
    m[w, [n, t]] = [0.5, 5.5]
    source = replace(source, costs=replace(source.costs, phoneme_distance=m))
    selection = select_units(source, track_of([("sil", 3), ("w", 4), ("sil", 3), ("w", 1)]))
    (fallback,) = selection.fallbacks
    assert (fallback.missing, fallback.used, fallback.frames) == (7, 4, 5)
    assert set(source.units.viseme[selection.units[3:7]]) == {4}
    said = str(fallback)
    assert said == "no unit shows w (viseme 7): 5 frames use units of viseme 4 (ey eh uh)"


def test_a_database_of_silence_alone_still_answers():
    source = make_source([[("sil", 8)]])
    selection = select_units(source, track_of(BIN))
    assert {f.used for f in selection.fallbacks} == {SILENCE}
    assert len(selection.fallbacks) == 3


def test_track_of_silence(source):
    selection = select_units(source, track_of([("sil", 10)]))
    assert (source.units.phoneme[selection.units] == SILENCE).all()


def test_weights_can_be_tried_on_one_graph(source):
    prepared = SelectionInput.of(source)
    track = track_of([("sil", 5), ("n", 3), ("ey", 3), ("s", 3), ("sil", 5)])
    graph = target_graph(prepared, track)
    for weights in (Weights(), Weights(1, 1, 0, 1), Weights(0.1, 1, 3, 0.01)):
        at_once = select_units(source, track, weights)
        assert select_path(prepared, graph, weights).costs.cost == at_once.costs.cost
    jumpy = select_path(prepared, graph, Weights(1, 0, 1, 1))
    smooth = select_path(prepared, graph, Weights(0.01, 1, 0, 1))
    assert np.count_nonzero(smooth.costs.skip) < np.count_nonzero(jumpy.costs.skip)
    assert jumpy.costs.target.sum() < smooth.costs.target.sum()


def test_recorded_gaps_break_the_natural_run(source):
    frame = source.units.frame.copy()
    frame[5:22] += 2
    selection = select_units(
        replace(source, units=replace(source.units, frame=frame)), track_of(BIN)
    )
    assert np.flatnonzero(selection.costs.skip).size > 0


# Frame rates


@pytest.mark.parametrize("fps", [25.0, 50.0, 30000 / 1001, 12.5])
def test_a_database_of_another_rate(fps):
    source = make_source([[(p, 2 * n) for p, n in s] for s in (BIN, LAY, SET)], fps=50.0)
    selection = select_units(source, track_of(BIN), Weights(1, 1, 0.1, 1))
    assert selection.units.tolist() == list(range(44))
    shown = selection.at_rate(fps)
    assert len(shown) == round(0.88 * fps)
    middle = (np.arange(len(shown)) + 0.5) / fps
    nearest = np.abs((np.arange(44) + 0.5)[None] / 50 - middle[:, None])
    chosen = nearest[np.arange(len(shown)), np.minimum(shown, 43)]
    assert chosen == pytest.approx(nearest.min(axis=1), abs=1e-9)


def test_twice_the_rate_shows_each_unit_twice(source):
    selection = select_units(source, track_of(LAY))
    assert (selection.at_rate(50.0) == np.repeat(selection.units, 2)).all()
    assert (selection.at_rate(25.0) == selection.units).all()


def test_longer_video_holds_the_last_unit(source):
    selection = select_units(source, track_of(LAY))
    shown = selection.at_rate(25.0, 30)
    assert (shown[:21] == selection.units).all()
    assert (shown[21:] == selection.units[-1]).all()


def test_phoneme_times_between_frames(source):
    # 0.9 s, with phonemes that begin inside frames; the middle of frame 7 is at 0.3 s.
    track = PhonemeTrack(
        np.array([SILENCE, PHONEME_INDEX["l"], SILENCE]), np.array([0.0, 0.131, 0.307, 0.9])
    )
    selection = select_units(source, track)
    assert len(selection.units) == 22
    assert np.flatnonzero(source.units.phoneme[selection.units]).tolist() == [3, 4, 5, 6, 7]


# What cannot be selected from


def test_everything_excluded(source):
    with pytest.raises(SelectionError, match="every sequence"):
        select_units(source, track_of(BIN), exclude_sequences=[0, 1, 2])


@pytest.mark.parametrize("exclude", [["none"], [3], [-1]])
def test_unknown_sequences(source, exclude):
    with pytest.raises(SelectionError, match="exclude"):
        select_units(source, track_of(BIN), exclude_sequences=exclude)


def test_empty_database(source):
    empty = Units(**{k: v[:0] for k, v in vars(source.units).items()})
    with pytest.raises(SelectionError, match="no unit"):
        select_units(replace(source, units=empty, phonemes=[np.zeros(0, np.uint8)]), track_of(BIN))


def test_settings_of_a_prepared_database(source):
    other = SelectionSettings(costs=CostSettings(beta1=-0.1), target=TargetSettings("paper"))
    with pytest.raises(SelectionError, match="other constants"):
        select_units(SelectionInput.of(source), track_of(BIN), other)
    prepared = SelectionInput.of(source, other.costs)
    assert len(select_units(prepared, track_of(BIN), other).units) == 22


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"target_scale": 0.0}, "scale"),
        ({"visual_scale": float("nan")}, "positive"),
        ({"feature_scales": np.array([1.0, 0, 1, 1])}, "positive"),
        ({"feature_scales": np.ones(3)}, "5 positive"),
        ({"phoneme_distance": np.full((43, 43), np.nan, np.float32)}, "phoneme distances"),
        ({"phoneme_distance": np.zeros((4, 4), np.float32)}, "phoneme distances"),
    ],
)
def test_cost_models_that_cannot_be_used(source, change, word):
    broken = replace(source, costs=replace(source.costs, **change))
    with pytest.raises(SelectionError, match=word):
        SelectionInput.of(broken)


def test_rates_that_cannot_be_shown(source):
    selection = select_units(source, track_of(LAY))
    with pytest.raises(SelectionError, match="frame rate"):
        selection.at_rate(0)
