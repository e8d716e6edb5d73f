"""Rest and closure: which frames ask for them, what units cost there, and what is chosen then."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from importlib import util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from database.errors import SelectionError
from database.phonemes import CLOSURES, PHONEME_INDEX, SILENCE, VISEME_OF
from database.reader import open_database
from database.schema import PhoneMarks, Phones, Units
from database.track import Interval, PhonemeTrack
from unitsel.costs import Weights
from unitsel.lip_targets import (
    BESIDE,
    OFF,
    Lips,
    RestSettings,
    closure_frames,
    lip_costs,
    rest_weights,
    resting,
    wanted_phonemes,
)
from unitsel.search import search
from unitsel.select import select_path, target_graph
from unitsel.settings import SelectionSettings, TargetSettings
from unitsel.source import SelectionInput

FPS = 25.0
ON = RestSettings()


def track_of(*phones: tuple[str, float]) -> PhonemeTrack:
    """Give the track of phones and their seconds."""
    ends = np.cumsum([seconds for _, seconds in phones])
    starts = [0.0, *ends[:-1]]
    return PhonemeTrack.from_intervals(
        [Interval(a, b, p) for a, b, (p, _) in zip(starts, ends, phones, strict=True)]
    )


@dataclass
class Source:
    """The part of a database that lips are measured from."""

    units: Units
    phones: Phones
    marks: PhoneMarks
    fps: float = FPS


def make_source(
    *sentences: tuple[PhonemeTrack, dict[str, float]], marks: PhoneMarks | None = None
) -> Source:
    """Give a database of sentences whose lips are open so many mm in each phoneme."""
    columns: dict[str, list[np.ndarray]] = {"sequence": [], "frame": [], "phoneme": []}
    opening, phones = [], []
    for s, (track, look) in enumerate(sentences):
        phonemes = track.sample(FPS)
        columns["sequence"].append(np.full(len(phonemes), s, np.int32))
        columns["frame"].append(np.arange(len(phonemes), dtype=np.int32))
        columns["phoneme"].append(phonemes)
        names = {PHONEME_INDEX[p]: mm for p, mm in look.items()}
        opening.append(np.array([names[p] for p in phonemes]))
        phones += [(s, PHONEME_INDEX[i.label], i.start, i.end) for i in track.intervals()]
    sequence, frame, phoneme = (np.concatenate(columns[name]) for name in columns)
    mm = np.concatenate(opening).astype(np.float32)
    mm += np.random.default_rng(0).normal(0, 0.01, len(mm)).astype(np.float32)
    zeros = np.zeros(len(mm), np.float32)
    units = Units(
        sequence, frame, phoneme, VISEME_OF[phoneme], mm[:, None], zeros + 50, mm + 15, mm, zeros,
        zeros, np.zeros((len(mm), 3), np.float32), np.zeros((len(mm), 3), np.float32),
    )  # fmt: skip
    kinds = (np.int32, np.uint8, np.float64, np.float64)
    listed = [np.array(c, k) for c, k in zip(zip(*phones, strict=True), kinds, strict=True)]
    return Source(units, Phones(*listed), marks or PhoneMarks.none())


def rest_marks(*rows: tuple[int, float, float]) -> PhoneMarks:
    """Give marks, of phones from a time to a time, heard and seen."""
    phone, start, end = zip(*rows, strict=True)
    sure = np.ones(len(rows), np.uint8)
    return PhoneMarks(np.array(phone, np.int32), np.array(start), np.array(end), sure, sure)


def test_a_long_silence_asks_for_rest_and_less_at_its_bounds() -> None:
    track = track_of(("aa", 0.4), ("sil", 1.2), ("iy", 0.4))
    weights = rest_weights(track, FPS, ON)
    assert not weights[:10].any() and not weights[40:].any()
    inside = weights[10:40]
    top = np.flatnonzero(inside > 1 - 1e-9)
    # 0.1 s after speech, 0.4 s before it.
    assert top[0] == 2 and top[-1] == 19 and (np.diff(top) == 1).all()
    assert (np.diff(inside[:3]) > 0).all() and (np.diff(inside[20:]) < 0).all()


@pytest.mark.parametrize("seconds", [0.2, 0.24, 0.3, 0.4])
def test_a_short_silence_comes_to_rest_once(seconds: float) -> None:
    weights = rest_weights(track_of(("aa", 0.4), ("sil", seconds), ("iy", 0.4)), FPS, ON)
    assert weights.max() == pytest.approx(1)
    within = np.arange(10, 10 + int(seconds * FPS + 1e-9))
    assert (weights[within] > 0).all() and not weights[: within[0]].any()


def test_silence_at_the_ends_rests_from_the_first_frame_to_the_last() -> None:
    weights = rest_weights(track_of(("sil", 0.6), ("aa", 0.4), ("sil", 0.6)), FPS, ON)
    assert weights[0] == 1 and weights[-1] == 1
    assert weights[14] < 0.1 and not weights[15:25].any() and 0 < weights[25] < 1


def test_what_is_no_rest() -> None:
    assert not rest_weights(track_of(("aa", 0.4), ("sil", 0.19), ("iy", 0.4)), FPS, ON).any()
    # Two phones of silence are one silence.
    halves = PhonemeTrack(
        np.array([PHONEME_INDEX["aa"], SILENCE, SILENCE]), np.array([0, 0.4, 0.5, 0.6])
    )
    assert rest_weights(halves, FPS, ON)[10:].any()
    assert rest_weights(track_of(("sil", 1.0)), FPS, ON).tolist() == [1.0] * 25


def test_lips_are_together_in_m_and_until_the_burst_of_p() -> None:
    track = track_of(("aa", 0.4), ("m", 0.16), ("aa", 0.4), ("p", 0.16), ("aa", 0.4))
    phone, weights = closure_frames(track, FPS)
    assert np.flatnonzero(phone == 1).tolist() == [10, 11, 12, 13]
    assert np.flatnonzero(phone == 3).tolist() == [24, 25, 26]
    assert (weights == (phone >= 0)).all()


@pytest.mark.parametrize("start", np.arange(0.4, 0.44, 0.004))
@pytest.mark.parametrize("seconds", [0.012, 0.03, 0.045])
def test_every_closure_has_a_frame_and_one_beside_it(start: float, seconds: float) -> None:
    track = track_of(("aa", float(start)), ("m", seconds), ("iy", 0.5))
    phone, weights = closure_frames(track, FPS)
    own = np.flatnonzero(phone == 1)
    assert len(own) >= 1 and (np.diff(own) == 1).all()
    middle = start + seconds / 2
    assert np.abs((own + 0.5) / FPS - middle).min() <= 0.5 / FPS + 1e-9
    if len(own) == 1:
        beside = np.flatnonzero(weights == BESIDE)
        assert len(beside) == 1 and abs(beside[0] - own[0]) == 1
    wanted = wanted_phonemes(track, FPS, ON)
    assert (wanted == PHONEME_INDEX["m"]).sum() >= 1
    # All else is as the track says.
    plain = track.sample(FPS)
    changed = wanted != plain
    assert changed.sum() <= 1 and (wanted[changed] == PHONEME_INDEX["m"]).all()
    assert (wanted_phonemes(track, FPS, OFF) == plain).all()


def test_a_closure_takes_no_frame_from_another() -> None:
    track = track_of(("aa", 0.4), ("m", 0.02), ("b", 0.02), ("iy", 0.4))
    assert set(wanted_phonemes(track, FPS, ON)[10:11].tolist()) <= CLOSURES
    # At the very ends too.
    for short in (track_of(("m", 0.01), ("aa", 0.3)), track_of(("aa", 0.3), ("p", 0.01))):
        phone, weights = closure_frames(short, FPS)
        assert (phone >= 0).sum() == 1 and weights.max() == 1


SPEECH = track_of(("sil", 1.0), ("aa", 0.6), ("m", 0.2), ("iy", 0.4), ("sil", 1.0))
LOOK = {"sil": 1.0, "aa": 8.0, "m": 1.2, "iy": 4.0}


def test_rest_and_opening_are_counted_from_the_persons_rest_to_wide_open() -> None:
    source = make_source((SPEECH, LOOK))
    lips = Lips.of(source)
    rests = source.units.phoneme == SILENCE
    assert np.abs(lips.opening[rests]).max() < 0.02 and lips.unrest[rests].max() < 0.02
    wide = source.units.phoneme == PHONEME_INDEX["aa"]
    assert lips.opening[wide].mean() == pytest.approx(1, abs=0.02)
    # Both opening and height are off, the teeth are not.
    assert lips.unrest[wide].mean() == pytest.approx(np.sqrt(2), abs=0.05)
    teeth = replace(source.units, teeth=np.where(wide, 1, 0).astype(np.float32))
    shown = Lips.of(replace(source, units=teeth))
    assert shown.unrest[wide].mean() == pytest.approx(np.sqrt(3), abs=0.05)


def test_who_rests_with_open_lips_rests_with_open_lips() -> None:
    source = make_source((SPEECH, {**LOOK, "sil": 3.0}))
    lips = Lips.of(source)
    open_rest, closed = source.units.phoneme == SILENCE, source.units.phoneme == PHONEME_INDEX["m"]
    assert lips.unrest[open_rest].max() < 0.02
    assert lips.unrest[closed].min() > 0.3


def test_marked_rests_rule_and_silence_stands_in() -> None:
    unmarked = make_source((SPEECH, LOOK))
    amid = np.flatnonzero(resting(unmarked))
    # More than 0.12 s from speech, on the side where there is some.
    assert amid.tolist() == [*range(22), *range(58, 80)]
    marked = replace(unmarked, marks=rest_marks((0, 0.0, 0.6), (4, 2.4, 3.0)))
    assert np.flatnonzero(resting(marked)).tolist() == [*range(15), *range(60, 75)]
    # Too few are no estimate.
    few = replace(unmarked, marks=rest_marks((0, 0.0, 0.4)))
    assert np.flatnonzero(resting(few)).tolist() == amid.tolist()
    # Seen only is better than nothing; a mark in a short silence is none.
    half = replace(marked.marks, sound=np.zeros(2, np.uint8))
    assert resting(replace(marked, marks=half)).sum() == 30
    breath = track_of(*[("aa", 0.2), ("sil", 0.16)] * 10, ("aa", 0.2))
    short = rest_marks(*[(1 + 2 * i, 0.2 + 0.36 * i, 0.36 + 0.36 * i) for i in range(10)])
    assert not resting(make_source((breath, LOOK), marks=short)).any()


@pytest.mark.parametrize("phones", [[("aa", 0.4), ("m", 0.2), ("iy", 0.3)], [("sil", 1.0)]])
def test_a_person_without_silence_or_without_speech(phones: list[tuple[str, float]]) -> None:
    lips = Lips.of(make_source((track_of(*phones), LOOK)))
    assert np.isfinite(lips.opening).all() and np.isfinite(lips.unrest).all()
    if len(phones) > 1:
        assert lips.opening[10:15].max() < 0.2 < lips.opening[:10].min()


def test_costs_stand_where_they_are_asked_for() -> None:
    source = make_source((SPEECH, LOOK))
    lips = Lips.of(source)
    every = np.arange(len(source.units), dtype=np.int32)
    track = track_of(("sil", 0.4), ("m", 0.2), ("aa", 0.4))
    costs = lip_costs(lips, track, FPS, [every] * 25, ON)
    assert costs is not None and len(costs) == 25
    assert costs[20] is None
    silence, closure = costs[0], costs[12]
    assert silence is not None and closure is not None
    np.testing.assert_allclose(silence, ON.rest * lips.unrest)
    np.testing.assert_allclose(closure, ON.closure * np.maximum(lips.opening - ON.closed, 0))
    assert lip_costs(lips, track, FPS, [every] * 25, OFF) is None
    only = lip_costs(lips, track, FPS, [every] * 25, RestSettings(rest=0))
    assert only is not None and only[0] is None and only[12] is not None


@pytest.mark.parametrize(
    "wrong", [{"rest": -1}, {"closure": float("nan")}, {"before": True}, {"closed": 2}]
)
def test_settings_that_cannot_be_used(wrong: dict[str, float]) -> None:
    with pytest.raises(SelectionError, match=f"lips: {next(iter(wrong))} must"):
        RestSettings(**wrong)


@pytest.fixture(scope="module")
def guided(makedb: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a database whose guides are random."""
    path: Path = makedb.make_database(
        tmp_path_factory.mktemp("lips") / "guided.h5", guided=True, sequences=8
    )
    return path


@pytest.mark.parametrize("target", ["paper", "mixed"])
def test_a_pause_rests_and_the_search_stays_exact(guided: Path, target: str) -> None:
    """A fast sentence with pauses that nobody recorded; the guide knows nothing, as in a pause."""
    track = track_of(
        *[("sil", 0.3), ("m", 0.045), ("iy", 0.1), ("b", 0.06), ("aa", 0.15), ("sil", 0.25)],
        *[("p", 0.05), ("ae", 0.12), ("m", 0.03), ("s", 0.1), ("sil", 0.4)],
    )
    with open_database(guided) as database:
        source = SelectionInput.of(database)
        weights = Weights(visual=0.1, skip=0.04)
        asked = rest_weights(track, source.fps, ON), closure_frames(track, source.fps)[1]
        unrest, opening = [], []
        for lips in (OFF, ON):
            graph = target_graph(source, track, target=TargetSettings(target), lips=lips)
            chosen = select_path(source, graph, weights)
            checked = search(source.space, graph.candidates, graph.target, weights, verify=True)
            assert checked.cost == pytest.approx(chosen.costs.cost, rel=1e-9)
            unrest.append(asked[0] @ source.lips.unrest[chosen.units])
            apart = np.maximum(source.lips.opening[chosen.units] - ON.closed, 0)
            opening.append(asked[1] @ apart)
        assert unrest[1] <= unrest[0] and opening[1] <= opening[0]
        if target == "mixed":
            assert unrest[1] < 0.9 * unrest[0] and opening[1] < 0.5 * opening[0]


def test_settings_of_a_selection_hold_lips_and_can_let_them_go() -> None:
    assert SelectionSettings().lips.used
    assert not replace(SelectionSettings(), lips=OFF).lips.used


@pytest.fixture(scope="module")
def benchmark() -> ModuleType:
    """Give `benchmarks/rest_closure.py`."""
    path = Path(__file__).parent.parent / "benchmarks" / "rest_closure.py"
    spec = util.spec_from_file_location("rest_closure", path)
    assert spec is not None and spec.loader is not None
    module = sys.modules["rest_closure"] = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_measure_fails_on_lips_that_chatter_freeze_or_gape(benchmark: ModuleType) -> None:
    track = track_of(("sil", 0.8), ("b", 0.12), ("aa", 0.4), ("m", 0.12), ("sil", 0.8))
    n = round(track.end * FPS)
    phonemes = track.sample(FPS)
    silent, closed = phonemes == SILENCE, np.isin(phonemes, list(CLOSURES))
    still = np.where(silent, 0.2 + 0.002 * np.sin(np.arange(n)), 0.3)
    together = np.where(silent | closed, 0.01, 0.06)

    def row(height: np.ndarray, opening: np.ndarray) -> tuple[float, float]:
        made = benchmark.Row()
        made.add(benchmark.Seen(np.arange(n), height, opening, []), track, 0.03, FPS)
        return made.hits, made.sd()

    hits, sd = row(still, together)
    assert hits == 1 and sd > 0
    chatter = np.where(silent & (np.arange(n) % 2 == 0), 0.25, still)
    assert row(chatter, together)[1] > benchmark.SILENCE_BAR[1] * sd
    assert row(np.where(silent, 0.2, 0.3), together)[1] < benchmark.SILENCE_BAR[0] * sd
    near = np.convolve(closed, np.ones(5), "same") > 0
    assert row(still, np.where(near, 0.06, together))[0] < hits - benchmark.CLOSURE_BAR
