"""Guides: what goes in, what is learnt, and the target cost that goes by them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from analysis.guide import GuideClip, GuideSettings, fit_guides
from database.errors import DatabaseError, SelectionError
from database.guide_model import (
    BINS,
    N_PHONE_INPUTS,
    N_SOUND_INPUTS,
    guide_inputs,
    mouth_parameters,
    predict,
)
from database.phonemes import N_PHONEMES, PHONEME_INDEX, SILENCE
from database.pictures import encode
from database.reader import UnitDatabase, open_database
from database.schema import GuideModel
from database.track import Interval, PhonemeTrack, frame_times
from database.writer import write_database
from unitsel.costs import Weights
from unitsel.guide import guided_costs
from unitsel.select import select_path, select_units, target_graph
from unitsel.settings import SelectionSettings, TargetSettings, default_settings
from unitsel.source import SelectionInput

QUICK = GuideSettings(fewest_clips=4, hidden=24, members=2, epochs=5, steps=150, held_back=3)
BINP = PhonemeTrack.from_intervals(
    [
        Interval(0.0, 0.3, "sil"),
        Interval(0.3, 0.4, "b"),
        Interval(0.4, 0.5, "ih"),
        Interval(0.5, 0.6, "n"),
        Interval(0.6, 0.9, "sil"),
    ]
)


def shares(inputs: np.ndarray) -> np.ndarray:
    return inputs[:, : (2 * BINS + 1) * N_PHONEMES].reshape(len(inputs), -1, N_PHONEMES)


def test_each_bin_shares_its_time_among_phonemes() -> None:
    inputs = guide_inputs(BINP, frame_times(22, 25))
    assert inputs.shape == (22, N_PHONE_INPUTS) and inputs.dtype == np.float32
    bins = shares(inputs)
    assert np.allclose(bins.sum(axis=2), 1, atol=1e-5)
    # Frame 9 is [0.36, 0.40): all of it is b; the next bin is all ih.
    assert bins[9, BINS, PHONEME_INDEX["b"]] == pytest.approx(1, abs=1e-5)
    assert bins[9, BINS + 1, PHONEME_INDEX["ih"]] == pytest.approx(1, abs=1e-5)
    # Frame 7 is [0.28, 0.32): half silence, half b.
    assert bins[7, BINS, PHONEME_INDEX["b"]] == pytest.approx(0.5, abs=1e-5)
    # Far outside all is silence.
    beyond = shares(guide_inputs(BINP, np.array([3.0])))
    assert np.allclose(beyond[0, :, SILENCE], 1)


def test_sound_comes_after_the_phones() -> None:
    sound = np.random.default_rng(0).normal(size=(90, 26)).astype(np.float32)
    inputs = guide_inputs(BINP, frame_times(22, 25), sound)
    assert inputs.shape == (22, N_PHONE_INPUTS + N_SOUND_INPUTS)
    assert np.array_equal(inputs[:, :N_PHONE_INPUTS], guide_inputs(BINP, frame_times(22, 25)))


def made_up_clips(database: UnitDatabase, sound: bool = True) -> list[GuideClip]:
    """The database's clips, with a sound that tells the mouth height."""
    units, clips = database.units, []
    for s in range(len(database.sequences)):
        mine = units.sequence == s
        times = (units.frame[mine] + 0.5) / database.fps
        height = np.interp(np.arange(300) / 100, times, units.mouth_height[mine])
        heard = np.repeat(height[:, None], 26, axis=1).astype(np.float32) / 10
        part = mouth_parameters(units)[mine]
        clips.append(GuideClip(database.sequence_track(s), times, part, heard if sound else None))
    return clips


@pytest.fixture(scope="module")
def guided(makedb: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small database with guides."""
    folder = tmp_path_factory.mktemp("guided")
    plain = makedb.make_database(folder / "plain.h5", sequences=12, seed=3)
    with open_database(plain) as database:
        clips = made_up_clips(database)
        guides = fit_guides(clips, QUICK)
    content, pictures, landmarks = makedb.make_content(sequences=12, seed=3)
    content = replace(
        content, guides=guides, sound=tuple(c.sound.astype(np.float16) for c in clips)
    )
    write_database(folder / "guided.h5", content, (encode(p, "png") for p in pictures), landmarks)
    return folder / "guided.h5"


def test_guides_are_learnt_stored_and_read(guided: Path) -> None:
    with open_database(guided) as database:
        assert database.guides == ("phonemes", "sound")
        units = database.units
        for kind in database.guides:
            guide = database.guide(kind)
            r = []
            for c in made_up_clips(database):
                sound = c.sound if kind == "sound" else None
                made = predict(guide, guide_inputs(c.track, c.times, sound))
                assert made.pca.shape == (len(c.times), units.pca.shape[1])
                assert (made.mouth_height >= 0).all() and (made.teeth <= 1).all()
                r.append(np.corrcoef(made.mouth_height, c.parameters[:, -4])[0, 1])
            assert np.mean(r) > 0.7
            assert (guide.gain >= 1).all() and (guide.skill > -1).all()
        sound = database.sound(2)
        assert sound is not None and sound.shape == (300, 26)
        assert default_settings(database).target.name == "mixed"


def test_skill_is_measured_on_clips_held_back(guided: Path) -> None:
    rng = np.random.default_rng(0)
    with open_database(guided) as database:
        clips = made_up_clips(database, sound=False)
        noise = [
            replace(c, parameters=rng.normal(size=c.parameters.shape).astype(np.float32))
            for c in clips
        ]
        learnt = fit_guides(clips, QUICK)["phonemes"]
        nothing = fit_guides(noise, replace(QUICK, steps=600))["phonemes"]
    assert learnt.skill[-4] > 0.5
    # A network that has all of the noise by heart knows none of the rest.
    assert np.abs(nothing.skill).max() < 0.4


def test_jobs_do_not_change_a_guide(guided: Path) -> None:
    with open_database(guided) as database:
        clips = made_up_clips(database)[:6]
    one, two = fit_guides(clips, QUICK, jobs=1), fit_guides(clips, QUICK, jobs=2)
    for kind in ("phonemes", "sound"):
        for name in ("columns", "hidden", "output", "gain", "skill"):
            assert np.array_equal(getattr(one[kind], name), getattr(two[kind], name)), (kind, name)


def test_small_or_silent_corpora_have_none(guided: Path) -> None:
    with open_database(guided) as database:
        clips = made_up_clips(database, sound=False)
    assert fit_guides(clips[:3], QUICK) == {}
    assert set(fit_guides(clips, QUICK)) == {"phonemes"}


def test_guided_cost_is_the_visual_distance(guided: Path) -> None:
    with open_database(guided) as database:
        source = SelectionInput.of(database)
    space = source.space
    candidates = np.arange(0, len(space), 7, dtype=np.int32)
    costs = guided_costs(space.features[20], space.features, space.groups, candidates)
    wanted = space.visual_costs(np.full(len(candidates), 20), candidates.astype(np.int64))
    assert np.allclose(costs, wanted, rtol=1e-5, atol=1e-5)
    rng = np.random.default_rng(5)
    pairs = rng.integers(0, len(space), (2, 4000))
    assert np.median(space.visual_costs(*pairs)) == pytest.approx(source.guide_scale, rel=0.1)


def test_shares_mix_the_two_costs(guided: Path) -> None:
    with open_database(guided) as database:
        source = SelectionInput.of(database)
        track = database.sequence_track(0)
    graph = target_graph(source, track, [0], TargetSettings("mixed", 0.25))
    assert graph.guided is not None and graph.predicted is not None
    for t in (0, 30, len(graph.paper) - 1):
        wanted = 0.75 * graph.paper[t] + 0.25 * graph.guided[t]
        assert np.allclose(graph.target[t], wanted)
    assert graph.with_share(0).target is graph.paper
    assert graph.with_share(1).target is graph.guided
    plain = target_graph(source, track, [0])
    assert plain.guided is None and all(
        np.array_equal(a, b) for a, b in zip(plain.target, graph.paper, strict=True)
    )
    with pytest.raises(SelectionError, match="without a guide"):
        plain.with_share(0.5)


def test_guided_selection_comes_nearer_to_the_prediction(guided: Path) -> None:
    with open_database(guided) as database:
        source = SelectionInput.of(database)
        track = database.sequence_track(4)
    graph = target_graph(source, track, [4], TargetSettings("guided"))
    assert graph.predicted is not None
    away = []
    for share in (0.0, 1.0):
        units = select_path(source, graph.with_share(share), Weights()).units
        away.append(float(np.abs(source.space.features[units] - graph.predicted).mean()))
    assert away[1] < 0.9 * away[0]


def test_what_a_target_cost_needs(guided: Path, small_db: Path) -> None:
    with open_database(guided) as database:
        source = SelectionInput.of(database)
        heard = database.sound(1)
        track = database.sequence_track(1)
        sound = SelectionSettings(target=TargetSettings("sound"))
        with pytest.raises(SelectionError, match="--audio"):
            select_units(source, track, sound)
        by_sound = select_units(source, track, sound, [1], sound=heard).units
        by_phones = select_units(source, track, SelectionSettings(), [1]).units
        assert not np.array_equal(by_sound, by_phones)
    with open_database(small_db) as database:
        assert default_settings(database).target.name == "paper"
        with pytest.raises(SelectionError, match="build it again from more clips"):
            select_units(database, BINP, SelectionSettings(target=TargetSettings("guided")))
        with pytest.raises(DatabaseError, match="holds no guide from sound"):
            database.guide("sound")
        assert database.sound(0) is None


def test_other_guides_can_take_their_place(guided: Path) -> None:
    with open_database(guided) as database:
        source = SelectionInput.of(database)
        model: Any = database.guide("phonemes")
    still = replace(model, output=np.zeros_like(model.output), gain=np.ones_like(model.gain))
    other = source.with_guides({"phonemes": still})
    assert isinstance(other.guides["phonemes"].model, GuideModel)
    assert np.ptp(other.guides["phonemes"].predicted(BINP, 25.0), axis=0).max() < 1e-5
    assert other.guides["sound"] is source.guides["sound"]
