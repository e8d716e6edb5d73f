"""One long recording of real clips, built through its pieces: as good as the clips one by one."""

import numpy as np
import pytest

from analysis.build import build_database
from analysis.footage import clips_of
from database.mask import Poses
from database.media import probe, read_sound, read_video
from database.reader import open_database
from database.sound import Sound
from database.timing import Timing, WordTrack, read_timing, write_timing
from database.track import Interval
from database.video_writer import VideoWriter
from render.background import Background
from render.playback import Playback
from unitsel import Synthesizer

SECONDS = 3.0


@pytest.fixture(scope="module")
def built(corpus, face_models, tmp_path_factory):
    """Databases of the clips, and of the clips joined into one video with one timing file."""
    folder = tmp_path_factory.mktemp("long")
    names = sorted(p.stem for p in corpus.glob("*.mpg"))
    names = names[3 :: max(1, len(names) // 3)][:3]
    (folder / "clips").mkdir()
    words, samples = [], []
    long = folder / "long.mp4"
    frames = int(SECONDS * 25)
    for name in names:
        for extension in (".mpg", ".align"):
            (folder / "clips" / (name + extension)).symlink_to(corpus / (name + extension))
        sound = read_sound(corpus / f"{name}.mpg", 44100).samples
        samples.append(np.resize(np.pad(sound, (0, 44100)), int(SECONDS * 44100)))
    info = probe(corpus / f"{names[0]}.mpg")
    sound = Sound(np.concatenate(samples), 44100)
    with VideoWriter(long, info.width, info.height, 25, sound, colour=info.colour, crf=8) as video:
        for i, name in enumerate(names):
            clip = list(read_video(corpus / f"{name}.mpg"))
            for k in range(frames):
                video.write_planes(clip[min(k, len(clip) - 1)].planes)
            spoken = read_timing(corpus / f"{name}.align").words.intervals()
            words += [Interval(w.start + i * SECONDS, w.end + i * SECONDS, w.label) for w in spoken]
    timing = Timing(None, WordTrack.from_intervals(words, duration=SECONDS * len(names)))
    write_timing(folder / "times.TextGrid", timing)
    single = build_database(folder / "clips", folder / "single.h5", jobs=1).path
    pieces = build_database(
        long, folder / "pieces.h5", timing=folder / "times.TextGrid", jobs=1
    ).path
    with open_database(single) as one, open_database(pieces) as other:
        yield one, other, long, folder


def spoken(track):
    return [i for i in track.intervals() if i.label != "sil"]


def test_pieces_end_in_pauses(built):
    _, db, long, folder = built
    words = read_timing(folder / "times.TextGrid").words
    clips = clips_of(long, timing=folder / "times.TextGrid")
    assert len(clips) == len(db.sequences) >= 2
    assert [c.name for c in clips] == list(db.sequences.name)
    for clip in clips[1:]:
        assert all(not s < clip.start < e for s, e in zip(words.starts, words.ends, strict=True))
        assert clip.start * 25 == pytest.approx(round(clip.start * 25))
    np.testing.assert_array_equal(db.starts, [c.start for c in clips])
    assert clips[0].end == pytest.approx(clips[1].start)


def test_the_phones_are_those_of_the_clips(built):
    one, other, _, _ = built
    alone = [
        (p.label, p.start + s * SECONDS)
        for s in range(len(one.sequences))
        for p in spoken(one.sequence_track(s))
    ]
    joined = [
        (p.label, p.start + other.starts[s])
        for s in range(len(other.sequences))
        for p in spoken(other.sequence_track(s))
    ]
    assert [label for label, _ in joined] == [label for label, _ in alone]
    apart = np.abs(np.array([t for _, t in joined]) - [t for _, t in alone])
    assert np.median(apart) <= 0.01
    assert apart.max() < 0.1


def test_the_frames_are_those_of_the_clips(built):
    one, other, _, _ = built
    assert len(other) == pytest.approx(len(one), abs=3)
    place = {}
    for i in range(len(one)):
        s = int(one.units.sequence[i])
        place[s * round(SECONDS * 25) + int(one.units.frame[i])] = i
    rows, same = [], []
    for i in range(len(other)):
        s = int(other.units.sequence[i])
        k = place.get(round(other.starts[s] * 25) + int(other.units.frame[i]))
        if k is not None:
            rows.append(i)
            same.append(k)
    assert len(rows) > 0.98 * len(one)
    turned = other.units.rotation[rows] - one.units.rotation[same]
    # The masks are made of other frames, so all of them may differ by one small turn.
    turned = np.abs(turned - np.median(turned, axis=0))
    opened = np.abs(other.units.inner_opening[rows] - one.units.inner_opening[same])
    assert np.rad2deg(np.median(turned)) < 0.5
    assert np.median(opened) < 0.3
    assert np.corrcoef(other.units.inner_opening[rows], one.units.inner_opening[same])[0, 1] > 0.98


def test_the_background_shows_the_tracked_frames(built):
    _, db, long, _ = built
    last = len(db.sequences) - 1
    mine = np.flatnonzero(db.units.sequence == last)
    poses = Poses(db.units.rotation[mine], db.units.translation[mine])
    start = float(db.starts[last])
    background = Background.from_tracked(long, db.fps, db.units.frame[mine], poses, start)
    played = Playback(background, db.fps, db.mask.patch, db.camera, length=5)
    whole = list(read_video(long))
    for i, frame in zip(range(5), played, strict=False):
        wanted = whole[round(start * 25) + background.first + i]
        np.testing.assert_array_equal(frame.planes.y, wanted.planes.y)


def test_the_synthesizer_opens_the_piece(built):
    _, db, long, _ = built
    synthesizer = Synthesizer(db)
    for background in (synthesizer.background(), synthesizer.background(long)):
        sequence = db.starts.tolist().index(background.start)
        assert background.path == long
        assert len(background) <= db.sequences.units[sequence]
