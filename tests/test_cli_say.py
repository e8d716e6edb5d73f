"""``unitsel say`` and ``unitsel dub``: text and recordings into videos of the puppet."""

from __future__ import annotations

import io
import json
import shlex
import sys
import wave
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import unitsel
from database.media import probe
from database.pictures import encode
from database.reader import open_database
from database.sound import read_sound
from database.track import frame_count
from database.writer import write_database

Run = Callable[..., tuple[int, str, str]]

TEXT = "Bin blue, now."


@pytest.fixture
def espeak() -> None:
    pytest.importorskip("espeakng_loader", reason="needs the optional extra `espeak`")


@pytest.fixture
def say(run: Run, puppet_db: Path, tmp_path: Path) -> Callable[..., dict]:
    """Say something into out.mp4 and give the JSON object."""

    def call(*arguments: object) -> dict:
        output = tmp_path / "out.mp4"
        status, out, err = run("say", puppet_db, *arguments, "-o", output, "--json")
        assert (status, err) == (0, ""), err
        document = json.loads(out)
        assert probe(output).frames == document["frames"]
        assert probe(output).has_sound
        assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]
        return document

    return call


@pytest.fixture
def speaker(tmp_path: Path) -> str:
    """Give a command that speaks, if only one sentence, and keeps what it was asked to say."""
    folder = tmp_path / "speaker"
    folder.mkdir()
    unitsel.speak(TEXT, wav=folder / "sentence.wav")
    program = folder / "speaker.py"
    program.write_text(
        "import pathlib, shutil, sys\n"
        "here = pathlib.Path(__file__).parent\n"
        "text = open(sys.argv[2]).read() if sys.argv[2:] else sys.stdin.read()\n"
        "(here / 'asked.txt').write_text(text)\n"
        "shutil.copy(here / 'sentence.wav', sys.argv[1])\n"
    )
    return shlex.join([sys.executable, str(program)])


@pytest.mark.usefixtures("espeak")
def test_a_sentence_is_spoken_and_shown(say: Callable[..., dict], tmp_path: Path) -> None:
    wav = tmp_path / "said.wav"
    found = say(TEXT, "--audio-out", wav, "--explain", tmp_path / "why.html")
    sound = read_sound(wav, None)
    assert found["audio"] == str(wav)
    assert found["frames"] == frame_count(sound.duration, 25)
    assert found["words"] == 3 and found["approximated"] == []
    assert "blue" in (tmp_path / "why.html").read_text()
    # The video carries that sound, sample for sample in time.
    heard = read_sound(tmp_path / "out.mp4", sound.rate).samples
    n = min(len(heard), len(sound.samples))
    assert np.corrcoef(heard[:n], sound.samples[:n])[0, 1] > 0.95


@pytest.mark.usefixtures("espeak")
def test_text_comes_from_a_file_and_from_standard_input(
    say: Callable[..., dict], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def said(*arguments: object) -> dict[str, object]:
        # espeak's times change by a millisecond from one call to the next, and costs with them.
        return {k: v for k, v in say(*arguments).items() if k not in ("cost", "segments")}

    expected = said(TEXT)
    (tmp_path / "text.txt").write_text(f"\ufeff{TEXT}\n", encoding="utf-8")
    assert said("--file", tmp_path / "text.txt") == expected
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(TEXT.encode())))
    assert said("-") == expected


@pytest.mark.usefixtures("espeak")
def test_voice_and_rate_and_what_english_lacks(say: Callable[..., dict]) -> None:
    found = say("Γειά σου κόσμε.", "--voice", "EL", "--rate", "300")
    assert {"symbol": "o", "phonemes": ["ow"], "known": True} in found["approximated"]
    lengths = [unitsel.speak(TEXT, rate=r).track.end for r in (300, None, 175, 100)]
    assert lengths[0] < lengths[1] < lengths[3]
    assert lengths[1] == pytest.approx(lengths[2], abs=0.01)


@pytest.mark.usefixtures("espeak")
def test_people_are_told_what_was_approximated(run: Run, puppet_db: Path, tmp_path: Path) -> None:
    status, out, _ = run("say", puppet_db, "χω", "--voice", "el", "-o", tmp_path / "o.mp4")
    assert status == 0
    assert "sounds that English lacks are shown by the nearest it has: x as k, o as ow" in out


@pytest.mark.usefixtures("espeak")
def test_another_program_speaks_and_is_aligned(
    say: Callable[..., dict], speaker: str, tmp_path: Path
) -> None:
    by_stdin = say(TEXT, "--tts", f"{speaker} {{wav}}")
    assert by_stdin["words"] == 3
    wav = tmp_path / "kept.wav"
    by_file = say(TEXT, "--tts", f"{speaker} {{wav}} {{text_file}}", "--audio-out", wav)
    assert by_file.pop("audio") == str(wav)
    assert (tmp_path / "speaker" / "asked.txt").read_text() == f"{TEXT}\n"
    assert by_file == by_stdin
    # The recording itself, with its words, is the same again.
    assert say(TEXT, "--tts", wav) == by_stdin
    own = unitsel.speak(TEXT).track.speech_span()
    assert unitsel.speak(TEXT, tts=str(wav)).track.speech_span() == pytest.approx(own, abs=0.06)


@pytest.mark.usefixtures("espeak")
def test_dub(run: Run, puppet_db: Path, tmp_path: Path) -> None:
    unitsel.speak(TEXT, wav=tmp_path / "voice.wav")
    (tmp_path / "voice.txt").write_text(TEXT)
    arguments = (puppet_db, tmp_path / "voice.wav", tmp_path / "voice.txt")
    status, out, err = run("dub", *arguments, "-o", tmp_path / "o.mp4", "--json")
    assert (status, err) == (0, "")
    document = json.loads(out)
    assert document["target"] == "paper", "four clips are too few for a guide"
    assert document["words"] == 3 and probe(tmp_path / "o.mp4").has_sound
    duration = read_sound(tmp_path / "voice.wav").duration
    assert document["frames"] == frame_count(duration, 25)


def test_dub_is_guided_by_the_sound_where_it_can_be(makedb: ModuleType, tmp_path: Path) -> None:
    from unitsel.cli import parser
    from unitsel.cli.making import _settings

    options = parser().parse_args(["dub", "x.h5", "a.wav", "a.txt", "-o", "o.mp4"])
    content, pictures, marks = makedb.make_content(guided=True)
    for guides, expected in ((content.guides, "sound"), ({}, "paper")):
        path = tmp_path / f"{expected}.h5"
        pieces = (encode(p, "png") for p in pictures)
        write_database(path, replace(content, guides=guides), pieces, marks, "png")
        with open_database(path) as database:
            assert _settings(options, database, hearing=True).target.name == expected
            assert _settings(options, database, hearing=False).target.name != "sound"


def _wav(path: Path) -> str:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(16000)
        file.writeframes(bytes(3200))
    return str(path)


FAILS = shlex.join(
    [
        sys.executable,
        "-c",
        "import sys; print('no model\\nvoice.onnx: missing', file=sys.stderr); sys.exit(3)",
    ]
)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["  "], "text: is empty"),
        ([], "give the text"),
        (["a", "--file", "b.txt"], "not two"),
        (["--file", "IN/none.txt"], "IN/none.txt"),
        (["--file", "IN/binary.txt"], "IN/binary.txt: is not a text in UTF-8 (byte 0)"),
        (["--file", "IN/empty.txt"], "IN/empty.txt: is empty"),
        (["a", "--tts", "festival"], "neither espeak"),
        (["a", "--tts", "no-such-program {wav}"], "no-such-program: cannot be run"),
        (["a", "--tts", f"{FAILS} {{wav}}"], "status 3: voice.onnx: missing"),
        (["a", "--tts", f"{sys.executable} -c pass {{wav}}"], "wrote no sound to {wav}"),
        (["a", "--tts", "piper {text}"], "put {wav} in its place"),
        (["a", "--tts", "piper {out} {wav}"], "knows no {out}; there are {text}"),
        (["a", "--tts", "piper 'x {wav}"], "cannot be read as a command"),
        (["a", "--tts", "piper {wav}", "--voice", "amy"], "has no {voice}"),
        (["...", "--tts", "IN/quiet.wav"], "punctuation only"),
        (["a", "--tts", "IN/quiet.wav", "--rate", "100"], "--rate changes nothing"),
        (["a", "--tts", "IN/empty.txt"], "IN/empty.txt"),
        (["a", "--audio-out", "IN/none/a.wav"], "IN/none"),
        (["a", "--audio-out", "IN/a.mp3"], "IN/a.mp3"),
        (["a", "--rate", "-1"], "--rate"),
    ],
)
def test_what_cannot_be_said_is_told_in_one_line(
    arguments: list[str], named: str, run: Run, puppet_db: Path, tmp_path: Path
) -> None:
    (tmp_path / "binary.txt").write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / "empty.txt").touch()
    _wav(tmp_path / "quiet.wav")
    before = sorted(tmp_path.iterdir())
    filled = [a.replace("IN", str(tmp_path)) for a in arguments]
    status, out, err = run("say", puppet_db, *filled, "-o", tmp_path / "o.mp4")
    assert (status, out) == (2, ""), err
    assert err.count("\n") == 1 and named.replace("IN", str(tmp_path)) in err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.usefixtures("espeak")
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["a", "--voice", "english"], "near it: en-gb, en-us"),
        (["a", "--voice", "en-us+zzz"], "no variant 'zzz'"),
        (["a", "--rate", "1000"], "80 to 450 words a minute"),
        (["..."], "nothing that voice 'en-us' can say"),
        (["a", "--target", "sound"], "the database holds none"),
    ],
)
def test_what_espeak_cannot_say(
    arguments: list[str], named: str, run: Run, puppet_db: Path, tmp_path: Path
) -> None:
    wav = tmp_path / "a.wav"
    output = ("-o", tmp_path / "o.mp4", "--audio-out", wav)
    status, out, err = run("say", puppet_db, *arguments, *output)
    assert (status, out) == (2, "") and err.count("\n") == 1 and named in err
    assert list(tmp_path.iterdir()) == []


def test_without_espeak_it_says_how_to_get_it(
    run: Run, puppet_db: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import analysis.espeak

    monkeypatch.setitem(sys.modules, "espeakng_loader", None)
    analysis.espeak.library.cache_clear()
    try:
        status, _, err = run("say", puppet_db, "hello", "-o", tmp_path / "o.mp4")
    finally:
        analysis.espeak.library.cache_clear()
    assert status == 2 and err.count("\n") == 1 and "pip install 'unitsel[espeak]'" in err
    assert list(tmp_path.iterdir()) == []
