"""``unitsel synth``: timing files in, videos out, over the puppet's database."""

from __future__ import annotations

import json
import wave
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import ModuleType

import av
import pytest

from database.fingerprint import identity
from database.media import probe, snap_rate
from database.reader import open_database
from database.sound import read_sound
from database.timing import Timing, WordTrack, write_timing
from database.track import Interval, PhonemeTrack, frame_count
from unitsel.costs import Weights
from unitsel.settings import settings_for

Run = Callable[..., tuple[int, str, str]]

KEYS = {
    *("video", "background", "frames", "fps", "seconds", "sound_copied", "sound_seconds"),
    *("segments", "cost", "fallbacks", "notes"),
}


@pytest.fixture
def synth(run: Run, puppet_db: Path, tmp_path: Path) -> Callable[..., dict[str, object]]:
    """Synthesize into out.mp4 and give the JSON object."""

    def call(*arguments: object) -> dict[str, object]:
        output = tmp_path / "out.mp4"
        status, out, err = run("synth", puppet_db, *arguments, "-o", output, "--json")
        assert (status, err) == (0, ""), err
        assert out.count("\n") == 1
        document = json.loads(out)
        assert set(document) - {"background_notes"} == KEYS
        assert document["video"] == str(output)
        assert document["frames"] == len(_times(output))
        assert document["seconds"] == pytest.approx(document["frames"] / document["fps"], abs=1e-4)
        assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]
        return document

    return call


def _times(video: Path) -> list[Fraction]:
    """Time of each frame of a video, in seconds."""
    with av.open(str(video)) as container:
        frames = list(container.decode(video=0))
    return [f.pts * f.time_base for f in frames]


@pytest.fixture
def timing() -> Timing:
    """``bin blue`` in whole hundredths of a second, which every format can write."""
    said = ["sil", "b", "ih", "n", "b", "l", "uw", "sil"]
    ends = [0.1, 0.18, 0.25, 0.31, 0.38, 0.46, 0.6, 0.7]
    phones = [Interval(a, b, p) for a, b, p in zip([0.0, *ends[:-1]], ends, said, strict=True)]
    words = WordTrack(("bin", "blue"), (0.1, 0.31), (0.31, 0.6), 0.7)
    return Timing(PhonemeTrack.from_intervals(phones), words)


@pytest.fixture
def grid(timing: Timing, tmp_path: Path) -> Path:
    """Give the timing as a TextGrid."""
    write_timing(tmp_path / "say.TextGrid", timing)
    return tmp_path / "say.TextGrid"


@pytest.mark.parametrize(
    ("name", "format"),
    [
        ("say.TextGrid", "textgrid-short"),
        ("say.lab", "htk"),
        ("say.pho", "mbrola"),
        ("say.csv", "csv"),
        ("say.csv", "mfa-csv"),
        ("say.json", "mfa-json"),
        ("say.json", "pocketsphinx"),
    ],
)
def test_every_format_says_the_same(
    name: str, format: str, timing: Timing, grid: Path, synth: Callable[..., dict], tmp_path: Path
) -> None:
    expected = synth(grid)
    write_timing(tmp_path / name, timing, format)
    found = synth(tmp_path / name)
    assert found["frames"] == frame_count(0.7, 25)
    assert found == expected


def test_words_alone_are_pronounced_by_the_dictionary(
    timing: Timing, synth: Callable[..., dict], tmp_path: Path
) -> None:
    assert timing.words is not None
    write_timing(tmp_path / "say.align", timing.words)
    found = synth(tmp_path / "say.align")
    assert found["frames"] == frame_count(0.7, 25)
    assert found["segments"] >= 1


def test_words_with_sound_are_aligned_to_it(
    puppet: ModuleType, puppet_corpus: Path, run: Run, synth: Callable[..., dict], tmp_path: Path
) -> None:
    if not puppet.can_speak():
        pytest.skip("needs speech: install the extra, unitsel[espeak]")
    name, sentence = next(iter(puppet.SPOKEN.items()))
    clip = puppet_corpus / f"{name}.mp4"
    words = tmp_path / "said.align"
    assert run("align", clip, puppet_corpus / f"{name}.txt", "-o", words)[0] == 0
    assert len(words.read_text().splitlines()) >= len(sentence.split())
    found = synth(words, "--audio", clip)
    assert found["frames"] == frame_count(read_sound(clip).duration, 25)
    aligned = tmp_path / "phones.TextGrid"
    assert run("align", clip, words, "-o", aligned)[0] == 0
    # With the sound, words mean the phones that align finds for them.
    assert synth(aligned, "--audio", clip)["cost"] == pytest.approx(found["cost"])
    assert synth(words)["cost"] != pytest.approx(found["cost"])


@pytest.mark.parametrize("fps", ["25", "29.97", "30", "50"])
def test_frame_times_are_exact_and_the_sound_is_there(
    fps: str, grid: Path, puppet_corpus: Path, synth: Callable[..., dict], tmp_path: Path
) -> None:
    clip = puppet_corpus / "hopper1.mp4"
    found = synth(grid, "--fps", fps, "--audio", clip)
    rate = snap_rate(float(fps))
    assert found["fps"] == pytest.approx(float(rate))
    # The sound lasts longer than the phones, so it gives the length.
    length = read_sound(clip).duration
    assert length > 1.5
    times = _times(tmp_path / "out.mp4")
    assert len(times) == frame_count(length, float(rate))
    assert all(abs(t - i / rate) < Fraction(1, 50000) for i, t in enumerate(times))
    info = probe(tmp_path / "out.mp4")
    assert info.has_sound
    assert read_sound(tmp_path / "out.mp4").duration == pytest.approx(length, abs=0.06)


def test_without_audio_there_is_no_sound(
    grid: Path, synth: Callable[..., dict], tmp_path: Path
) -> None:
    synth(grid)
    assert not probe(tmp_path / "out.mp4").has_sound


def test_sound_shorter_than_the_phones_is_followed_by_silence(
    puppet: ModuleType, puppet_corpus: Path, grid: Path, synth: Callable[..., dict], tmp_path: Path
) -> None:
    track, words = puppet.even_track("bin blue at f two now", 0.2, 2.2)
    write_timing(tmp_path / "long.TextGrid", Timing(track, words))
    found = synth(tmp_path / "long.TextGrid", "--audio", puppet_corpus / "hopper1.mp4")
    assert found["frames"] == frame_count(track.end, 25)
    # Packets that are taken over as they are cannot be lengthened; that is told.
    assert found["sound_copied"]
    length = read_sound(puppet_corpus / "hopper1.mp4").duration
    assert found["sound_seconds"] == pytest.approx(length, abs=0.06)
    samples = read_sound(puppet_corpus / "hopper1.mp4")
    with wave.open(str(tmp_path / "short.wav"), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(samples.rate)
        file.writeframes((samples.samples * 32767).astype("<i2").tobytes())
    found = synth(tmp_path / "long.TextGrid", "--audio", tmp_path / "short.wav")
    assert not found["sound_copied"]
    assert found["sound_seconds"] == pytest.approx(track.end, abs=0.06)
    assert read_sound(tmp_path / "out.mp4").duration == pytest.approx(track.end, abs=0.06)
    (note,) = found["notes"]
    assert "short.wav: lasts 2.05 s, and the timings end at 2.70 s; the rest is silent" in note


def test_sound_longer_than_the_phones_is_told(
    puppet: ModuleType,
    puppet_db: Path,
    puppet_corpus: Path,
    run: Run,
    synth: Callable[..., dict],
    tmp_path: Path,
) -> None:
    track, words = puppet.even_track("bin blue", 0.1, 0.4)
    timing = tmp_path / "short.TextGrid"
    write_timing(timing, Timing(track, words))
    audio = ("--audio", puppet_corpus / "hopper1.mp4")
    (note,) = synth(timing, *audio)["notes"]
    assert "the timings end at 0.80 s; the mouth rests till its end" in note
    status, out, err = run("synth", puppet_db, timing, "-o", tmp_path / "out.mp4", *audio)
    assert (status, err) == (0, "") and note in out


def test_background_of_the_database_and_of_other_footage(
    puppet: ModuleType, puppet_corpus: Path, grid: Path, synth: Callable[..., dict], tmp_path: Path
) -> None:
    own = puppet_corpus / "hopper3.mp4"
    assert synth(grid, "--background", own)["background"] == str(own)
    track, _ = puppet.even_track("bin", 0.2, 0.3)
    other = tmp_path / "other.mp4"
    puppet.write_clip(other, track, None, 77)
    found = synth(grid, "--background", other)
    assert found["background"] == str(other)
    assert found["frames"] == frame_count(0.7, 25)
    info = probe(tmp_path / "out.mp4")
    assert (info.width, info.height) == (puppet.WIDTH, puppet.HEIGHT)


def test_a_viseme_without_units_is_reported(
    grid: Path, run: Run, puppet_db: Path, synth: Callable[..., dict], tmp_path: Path
) -> None:
    assert synth(grid)["fallbacks"] == []
    path = tmp_path / "joy.lab"
    path.write_text("0 2000000 sil\n2000000 5000000 oy\n5000000 7000000 sil\n")
    fallbacks = synth(path)["fallbacks"]
    assert len(fallbacks) == 1
    assert fallbacks[0].startswith("no unit shows oy")
    status, out, err = run("synth", puppet_db, path, "-o", tmp_path / "out.mp4")
    assert (status, err) == (0, "")
    assert fallbacks[0] in out.splitlines()
    assert f"{tmp_path / 'out.mp4'}: {frame_count(0.7, 25)} frames at 25 a second" in out


def test_weights_of_a_file_are_used(grid: Path, synth: Callable[..., dict], tmp_path: Path) -> None:
    plain = synth(grid)
    assert synth(grid) == plain
    settings_for("paper").write(tmp_path / "same.json")
    assert synth(grid, "--weights", tmp_path / "same.json") == plain
    phones = replace(settings_for("paper"), weights=Weights(target=1, concatenation=0))
    phones.write(tmp_path / "phones.json")
    found = synth(grid, "--weights", tmp_path / "phones.json")
    assert found["segments"] > plain["segments"]
    assert found["cost"] < plain["cost"]


def test_weights_of_another_database_are_refused(
    grid: Path, puppet_db: Path, run: Callable[..., tuple[int, str, str]], tmp_path: Path
) -> None:
    weights = tmp_path / "weights.json"
    with open_database(puppet_db) as database:
        settings_for("paper").write(weights, database=identity(database))
    out = tmp_path / "out.mp4"
    assert run("synth", puppet_db, grid, "-o", out, "--weights", weights)[0] == 0
    out.unlink()
    settings_for("paper").write(weights, database="0" * 32)
    status, _, err = run("synth", puppet_db, grid, "-o", out, "--weights", weights)
    assert status == 2 and not out.exists()
    assert err.startswith(f"unitsel: {weights}: was trained on another database")


def test_a_target_cost_without_its_guide_is_refused(
    grid: Path, puppet_db: Path, run: Callable[..., tuple[int, str, str]], tmp_path: Path
) -> None:
    out = tmp_path / "out.mp4"
    status, _, err = run("synth", puppet_db, grid, "-o", out, "--target", "guided")
    assert status == 2 and not out.exists()
    assert "needs a guide from phonemes" in err and "or choose 'paper'" in err
