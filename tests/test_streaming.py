"""Streams: pictures while later text still arrives, in step with the sound; and their files."""

from __future__ import annotations

import gc
import threading
import time
import weakref
from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import av
import numpy as np
import pytest
from PIL import Image

from database.errors import MediaError, RenderError, SelectionError
from database.media import probe, read_sound, read_video
from database.planes import Planes
from database.reader import UnitDatabase, open_database
from database.sound import Sound
from database.track import PhonemeTrack, frame_count
from database.video_writer import VideoWriter
from unitsel.pieces import LONG, pieces
from unitsel.placed import placed
from unitsel.synthesizer import Synthesizer
from unitsel.writing import Encoding

RATES = [25, 29.97, 30, 50, 59.94]


@pytest.fixture(scope="module")
def database(puppet_db: Path) -> Iterator[UnitDatabase]:
    with open_database(puppet_db) as opened:
        yield opened


@pytest.fixture(scope="module")
def synthesizer(database: UnitDatabase) -> Synthesizer:
    return Synthesizer(database)


@pytest.fixture(scope="module")
def track(puppet: ModuleType) -> PhonemeTrack:
    return puppet.even_track("set blue", 0.1, 0.4)[0]


class Piece:
    """Something that lasts."""

    def __init__(self, duration: float) -> None:
        self.duration = duration


@pytest.mark.parametrize("rate", [25, 30000 / 1001, 30, 50, 60000 / 1001])
def test_an_hour_of_utterances_stays_within_a_frame_of_its_sound(rate: float) -> None:
    exact = Fraction(rate).limit_denominator(1001)
    rng = np.random.default_rng(3)
    lengths = rng.uniform(0.3, 4.0, 1700)
    found = list(placed(((Piece(x), None) for x in lengths), exact))
    ends = np.cumsum(lengths)
    assert ends[-1] > 3600
    assert found[0].first == 0
    for before, after in pairwise(found):
        assert before.stop == after.first
    stops = np.array([u.stop for u in found]) / float(exact)
    assert np.abs(stops - ends).max() <= 0.5 / float(exact) + 1e-6


def test_the_first_picture_does_not_wait_for_later_text(
    synthesizer: Synthesizer, track: PhonemeTrack
) -> None:
    arrived = threading.Event()

    def tracks() -> Iterator[PhonemeTrack]:
        yield track
        assert arrived.wait(20)
        yield track

    frames = synthesizer.stream(tracks())
    first = [next(frames) for _ in range(frame_count(track.end, 25))]
    assert not arrived.is_set()
    assert [f.index for f in first] == list(range(len(first)))
    assert {f.utterance.index for f in first} == {0}
    arrived.set()
    rest = list(frames)
    assert {f.utterance.index for f in rest} == {1}
    assert rest[0].time == pytest.approx(rest[0].utterance.start, abs=0.5 / 25)


def test_a_stream_is_what_render_draws(synthesizer: Synthesizer, track: PhonemeTrack) -> None:
    selection = synthesizer.select(track)
    alone = list(synthesizer.render(selection))
    streamed = list(synthesizer.stream([track]))
    assert len(alone) == len(streamed)
    for planes, frame in zip(alone, streamed, strict=True):
        assert isinstance(frame.picture, Planes)
        assert np.array_equal(planes.y, frame.picture.y)
        assert np.array_equal(planes.u, frame.picture.u)
        assert frame.time == frame.index / 25


def test_the_background_and_the_mouth_go_on_from_one_utterance_to_the_next(
    synthesizer: Synthesizer, track: PhonemeTrack
) -> None:
    frames = list(synthesizer.stream([track, track, track]))
    top = [f.picture.y[:20].astype(int) for f in frames if isinstance(f.picture, Planes)]
    twice = list(synthesizer.render(synthesizer.select(track)))
    n = len(twice)
    assert len(frames) == frame_count(3 * track.end, 25)
    # The second utterance does not begin again where the first began.
    assert np.array_equal(top[0], twice[0].y[:20])
    assert not np.array_equal(top[n], top[0])
    first, second = frames[0].utterance.selection, frames[n + 1].utterance.selection
    alone = synthesizer.select(track)
    assert first.units.tolist() == alone.units.tolist()
    after = synthesizer.select(track, after=first)
    assert second.units.tolist() == after.units.tolist()
    assert after.costs.target.shape == alone.costs.target.shape


def test_following_the_last_mouth_costs_least_with_the_step_to_it(
    synthesizer: Synthesizer, track: PhonemeTrack
) -> None:
    space = synthesizer._source.space
    weights = synthesizer.settings.weights
    before = synthesizer.select(track)
    free, bound = before, synthesizer.select(track, after=before)

    def whole(selection: object) -> float:
        units = np.array([before.units[-1], selection.units[0]])  # type: ignore[attr-defined]
        step = weights.visual * space.visual_costs(units[:1], units[1:])[0]
        step += weights.skip * space.skip_costs(units[:1], units[1:])[0]
        cost: float = selection.costs.cost + weights.concatenation * step  # type: ignore[attr-defined]
        return cost

    assert whole(bound) <= whole(free) + 1e-9
    assert bound.costs.cost >= free.costs.cost - 1e-9


def test_only_so_many_utterances_are_taken_ahead(
    synthesizer: Synthesizer, track: PhonemeTrack
) -> None:
    taken = []

    def tracks() -> Iterator[PhonemeTrack]:
        for i in range(30):
            taken.append(i)
            yield track

    frames = synthesizer.stream(tracks(), look_ahead=2)
    n = frame_count(track.end, 25)
    next(frames)
    time.sleep(0.3)
    # Being read ahead, selected and waiting, being selected.
    ahead = 1 + (12 + 8 + 2) // n + 2 + 1
    assert len(taken) <= 1 + ahead
    frames.close()


def test_closing_a_stream_ends_its_threads(synthesizer: Synthesizer, track: PhonemeTrack) -> None:
    never = threading.Event()

    def tracks() -> Iterator[PhonemeTrack]:
        yield track
        never.wait(30)

    frames = synthesizer.stream(tracks())
    next(frames)
    started = time.perf_counter()
    frames.close()
    assert time.perf_counter() - started < 3
    never.set()
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline:
        names = [t.name for t in threading.enumerate() if t.name.startswith("unitsel-")]
        if not names:
            break
        time.sleep(0.02)
    assert not names


def test_what_goes_wrong_later_is_raised_after_what_went_well(
    synthesizer: Synthesizer, track: PhonemeTrack, tmp_path: Path
) -> None:
    def tracks() -> Iterator[PhonemeTrack]:
        yield track
        raise SelectionError("the text broke off")

    got = []
    with pytest.raises(SelectionError, match="broke off"):
        for frame in synthesizer.stream(tracks()):
            got.append(frame)
    assert len(got) == frame_count(track.end, 25)
    with pytest.raises(SelectionError, match="broke off"):
        synthesizer.write_stream(tracks(), tmp_path / "o.mp4")
    with pytest.raises(MediaError, match="no utterance"):
        synthesizer.write_stream([], tmp_path / "o.mp4")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("fps", RATES)
def test_sound_and_picture_of_a_written_stream_are_in_step(
    fps: float, synthesizer: Synthesizer, track: PhonemeTrack, tmp_path: Path
) -> None:
    """A click at the start of each utterance, one of which is too long and one too short."""
    rate = 22050
    sounds = []
    for length in (track.end, track.end + 0.4, 0.3):
        samples = np.zeros(round(length * rate), np.float32)
        samples[:90] = 0.9
        sounds.append(Sound(samples, rate))
    path = tmp_path / "o.mp4"
    seen: list[object] = []
    written = synthesizer.write_stream(
        [(track, s) for s in sounds], path, fps=fps, begun=seen.append
    )
    assert len(seen) == 3
    assert written.frames == frame_count(3 * track.end, written.fps)
    heard = np.abs(read_sound(path, None).samples) > 0.3
    for i in range(3):
        window = heard[max(0, round((i * track.end - 0.1) * rate)) :]
        place = np.argmax(window) / rate + max(0, i * track.end - 0.1)
        assert place == pytest.approx(i * track.end, abs=0.5 / 60)
    with av.open(str(path)) as container:
        stamps = [f.pts * f.time_base for f in container.decode(container.streams.video[0])]
    exact = Fraction(written.fps).limit_denominator(1001)
    assert stamps == [i / exact for i in range(written.frames)]


def test_a_background_of_variable_rate_keeps_step(
    synthesizer: Synthesizer, track: PhonemeTrack, tmp_path: Path
) -> None:
    """The background's stamps leave frames out; the output has every frame at its time."""
    own = synthesizer.background()
    uneven = tmp_path / "uneven.mkv"
    kept = [f for f in read_video(own.path, own.fps) if f.index % 3 != 1]
    with av.open(str(uneven), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height = kept[0].planes.width, kept[0].planes.height
        stream.pix_fmt = "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        stream.codec_context.options = {"crf": "4"}
        for f in kept:
            frame = av.VideoFrame.from_ndarray(f.planes.packed(), format="yuv420p")
            frame.pts, frame.time_base = 40 * f.index, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    background = type(own)(uneven, own.fps, own.first, own.poses)
    plain = list(synthesizer.render(synthesizer.select(track), background=own))
    drawn = list(synthesizer.render(synthesizer.select(track), background=background))
    assert len(plain) == len(drawn)
    for i, (a, b) in enumerate(zip(plain, drawn, strict=True)):
        if (i + own.first) % 3 != 1:
            assert np.abs(a.y[:40].astype(int) - b.y[:40]).mean() < 1.5


def test_outside_the_mouth_only_the_encoder_touches_the_picture(
    synthesizer: Synthesizer, track: PhonemeTrack, tmp_path: Path
) -> None:
    """PSNR outside the blend region as when the background itself is encoded."""
    selection = synthesizer.select(track)
    background = synthesizer.background()
    made = synthesizer.write(selection, tmp_path / "made.mp4").path
    drawn = list(synthesizer.render(selection))
    info = probe(background.path)
    originals = [
        f.planes for f in read_video(background.path, background.fps) if f.index >= background.first
    ][: len(drawn)]
    with VideoWriter(
        tmp_path / "plain.mp4", info.width, info.height, 25, colour=info.colour
    ) as video:
        for planes in originals:
            video.write_planes(planes)
    errors: dict[str, list[float]] = {"made": [], "plain": []}
    encoded = {
        name: [f.planes for f in read_video(tmp_path / f"{name}.mp4")] for name in ("made", "plain")
    }
    assert made.name == "made.mp4"
    for i, original in enumerate(originals):
        changed = drawn[i].y != original.y
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        outside = np.ones(changed.shape, bool)
        # Blocks of 16 that the mouth reaches into share its transforms.
        top, left = rows.min() // 16 * 16 - 16, columns.min() // 16 * 16 - 16
        outside[max(0, top) : rows.max() + 33, max(0, left) : columns.max() + 33] = False
        for name, frames in encoded.items():
            difference = frames[i].y.astype(float) - original.y
            errors[name].append(float(np.mean(difference[outside] ** 2)))
    psnr = {name: 10 * np.log10(255**2 / np.mean(e)) for name, e in errors.items()}
    assert abs(psnr["made"] - psnr["plain"]) < 0.5


def test_the_mouth_alone_laid_over_the_background_gives_the_picture(
    synthesizer: Synthesizer, track: PhonemeTrack, tmp_path: Path
) -> None:
    selection = synthesizer.select(track)
    folder = synthesizer.write(
        selection, tmp_path / "mouth", encoding=Encoding(alpha=True, comment="for the cutter")
    ).path
    whole = synthesizer.write(selection, tmp_path / "whole").path
    names = sorted(p.name for p in folder.iterdir())
    assert names == [f"{i:06d}.png" for i in range(frame_count(track.end, 25))]
    assert Image.open(folder / names[0]).text["Comment"] == "for the cutter"  # type: ignore[attr-defined]
    background = synthesizer.background()
    info = probe(background.path)
    frames = (f for f in read_video(background.path, 25) if f.index >= background.first)
    for name, under in zip(names, frames, strict=False):
        layer = np.asarray(Image.open(folder / name)).astype(float)
        alpha = layer[..., 3:] / 255
        laid = under.rgb * (1 - alpha) + layer[..., :3] * alpha
        wanted = np.asarray(Image.open(whole / name)).astype(float)
        assert wanted.shape == (info.height, info.width, 3)
        # Halved chroma is what keeps them apart.
        assert np.abs(laid - wanted).mean() < 0.6
        assert (layer[..., 3] > 0).mean() < 0.3
    with pytest.raises(MediaError, match="files in it"):
        synthesizer.write(selection, folder)


def test_size_is_as_asked(synthesizer: Synthesizer, track: PhonemeTrack, tmp_path: Path) -> None:
    info = probe(synthesizer.background().path)
    size = (info.width * 2, info.height * 2)
    selection = synthesizer.select(track)
    written = synthesizer.write(selection, tmp_path / "o.webm", encoding=Encoding(size=size))
    large = probe(written.path)
    assert (large.width, large.height) == size
    small = next(iter(synthesizer.render(selection)))
    big = next(iter(synthesizer.render(selection, size=size)))
    shrunk = big.y.reshape(info.height, 2, info.width, 2).mean(axis=(1, 3))
    assert np.abs(shrunk - small.y).mean() < 2
    with pytest.raises(RenderError, match="of the same shape, such as"):
        synthesizer.write(selection, tmp_path / "p.mp4", encoding=Encoding(size=(64, 640)))
    assert [p.name for p in tmp_path.iterdir()] == ["o.webm"]


def test_files_say_that_they_are_synthetic(
    synthesizer: Synthesizer, track: PhonemeTrack, tmp_path: Path
) -> None:
    selection = synthesizer.select(track)
    encoding = Encoding(comment="a trial")
    for name in ("o.mp4", "o.webm", "o.mkv", "o.mov"):
        path = synthesizer.write(selection, tmp_path / name, encoding=encoding).path
        with av.open(str(path)) as container:
            tags = {k.lower(): v for k, v in container.metadata.items()}
        assert tags["comment"] == "a trial"
        assert "did not say this" in tags["description"]
        assert synthesizer.provenance().checksum in tags["synopsis"]
        assert synthesizer.database.path.name in tags["description"]


def test_long_tracks_are_cut_in_pauses(puppet: ModuleType) -> None:
    one = puppet.even_track("set blue now", 0.1, 0.3)[0]
    assert pieces(one) == [one]
    n = int(2.5 * LONG / one.end)
    bounds = np.concatenate([[0.0], *(one.boundaries[1:] + i * one.end for i in range(n))])
    long = PhonemeTrack(np.tile(one.phonemes, n), bounds)
    parts = pieces(long)
    assert 3 <= len(parts) <= 10
    assert sum(p.end for p in parts) == pytest.approx(long.end)
    sampled = np.concatenate([p.at(np.arange(0.0005, p.end, 0.001)) for p in parts])
    whole = long.at(np.arange(0.0005, long.end, 0.001))
    assert abs(len(sampled) - len(whole)) <= len(parts)
    start = 0.0
    for p in parts[:-1]:
        start += p.end
        assert long.at([start])[0] == long.phonemes[-1]  # Silence.


def test_a_track_without_a_pause_is_cut_all_the_same() -> None:
    vowels = PhonemeTrack(np.tile([1, 2], 2000), np.arange(4001) * 0.1)
    assert max(p.end for p in pieces(vowels)) <= 60 + 1e-6
    drone = PhonemeTrack(np.array([1]), np.array([0.0, 200.0]))
    parts = pieces(drone)
    assert sum(p.end for p in parts) == pytest.approx(200)
    assert max(p.end for p in parts) <= 60 + 1e-6


def test_what_was_shown_is_forgotten(synthesizer: Synthesizer, puppet: ModuleType) -> None:
    """Of forty utterances only those that are being made and shown are held."""
    short = puppet.even_track("set", 0.05, 0.1)[0]
    held: list[weakref.ref[object]] = []
    most = 0
    gc.collect()
    gc.freeze()  # What was there before need not be gone through forty times.
    try:
        for frame in synthesizer.stream([short] * 40):
            if frame.utterance.index == len(held):
                held.append(weakref.ref(frame.utterance.selection))
                gc.collect()
                most = max(most, sum(r() is not None for r in held))
    finally:
        gc.unfreeze()
    assert len(held) == 40
    assert most <= 6
