"""Bad input to every command: one clear line, exit status 2, nothing half-written."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from database.timing import Timing, write_timing
from database.video_writer import VideoWriter
from unitsel.cli import main

GOOD_WEIGHTS = {"target": 1, "concatenation": 1, "visual": 1, "skip": 1}


def _weights(**changes: object) -> str:
    weights = {k: v for k, v in (GOOD_WEIGHTS | changes).items() if v is not None}
    return json.dumps({"format": "unitsel-weights", "version": 1, "weights": weights})


@pytest.fixture(scope="module")
def inputs(puppet_db: Path, puppet: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder of good and bad files, read by all tests here."""
    folder = tmp_path_factory.mktemp("inputs")
    whole = puppet_db.read_bytes()
    (folder / "db.h5").write_bytes(whole)
    (folder / "half.h5").write_bytes(whole[: len(whole) // 2])
    (folder / "empty.h5").touch()
    (folder / "text.h5").write_text("not a database\n" * 100)
    (folder / "folder.h5").mkdir()

    track, words = puppet.even_track("bin blue now", 0.2, 0.6)
    write_timing(folder / "good.TextGrid", Timing(track, words))
    (folder / "cut.TextGrid").write_bytes((folder / "good.TextGrid").read_bytes()[:900])
    binary = np.random.default_rng(0).integers(0, 256, 3000, dtype=np.uint8).tobytes()
    for extension in ("TextGrid", "lab", "pho", "csv", "json", "align"):
        (folder / f"empty.{extension}").touch()
        (folder / f"binary.{extension}").write_bytes(binary)
    (folder / "folder.lab").mkdir()
    (folder / "phones.xyz").write_text("0 1 a\n")
    (folder / "odd.lab").write_text("0 1000000 b\n1000000 2000000 iy\n2000000 3000000 qqq\n")
    (folder / "empty.txt").touch()
    (folder / "words.txt").write_text("bin blue now\n")

    (folder / "nan.json").write_text(_weights(target=float("nan")))
    (folder / "negative.json").write_text(_weights(visual=-1))
    (folder / "lacking.json").write_text(_weights(skip=None))
    (folder / "nojson.json").write_text("weights!\n")

    for name in ("faceless", "mute", "wordless", "broken", "void"):
        (folder / name).mkdir()
    with VideoWriter(folder / "faceless/clip.mp4", 288, 352, 25, puppet.hum(track)) as video:
        for _ in range(round(track.end * 25)):
            video.write_rgb(np.full((352, 288, 3), 90, np.uint8))
    write_timing(folder / "faceless/clip.TextGrid", Timing(track, words))
    puppet.write_clip(folder / "mute/clip.mp4", track, None)
    (folder / "mute/clip.txt").write_text("bin blue now\n")
    puppet.write_clip(folder / "wordless/clip.mp4", track, puppet.hum(track))
    (folder / "broken/clip.mp4").write_bytes(binary)
    (folder / "broken/clip.txt").write_text("bin blue now\n")
    (folder / "dots.txt").write_text("?! ... -\n")
    return folder


def _synth(*, db: str = "db.h5", timing: str = "good.TextGrid", out: str = "OUT/o.mp4", more=()):
    return ("synth", f"IN/{db}", f"IN/{timing}", "-o", out, *more)


def _say(text: str, *more: str):
    return ("say", "IN/db.h5", text, "-o", "OUT/o.mp4", *more)


TIMINGS = [
    *(f"{kind}.{e}" for kind in ("empty", "binary") for e in ("TextGrid", "lab", "pho", "csv")),
    *("empty.json", "binary.json", "empty.align", "binary.align", "cut.TextGrid"),
    *("missing.TextGrid", "phones.xyz", "words.txt", "odd.lab", "folder.lab"),
]
DATABASES = ["half.h5", "empty.h5", "text.h5", "folder.h5", "missing.h5"]
WEIGHTS = ["nan.json", "negative.json", "lacking.json", "nojson.json", "missing.json"]
LINE = ("IN/wordless/clip.mp4", "IN/words.txt")

BAD: list[tuple[tuple[str, ...], str]] = [
    # Timing files
    *((_synth(timing=name), f"IN/{name}") for name in TIMINGS),
    # Databases
    *((_synth(db=name), f"IN/{name}") for name in DATABASES),
    *((("inspect", f"IN/{name}"), f"IN/{name}") for name in DATABASES),
    *((("evaluate", f"IN/{name}", "IN/wordless"), f"IN/{name}") for name in DATABASES),
    # Weights
    *((_synth(more=("--weights", f"IN/{name}")), f"IN/{name}") for name in WEIGHTS),
    (("evaluate", "IN/db.h5", "IN/mute", "--weights", "IN/nan.json"), "IN/nan.json"),
    # Outputs
    (_synth(out="OUT/none/o.mp4"), "OUT/none"),
    (_synth(out="OUT/o.avi"), "OUT/o.avi"),
    (_synth(out="OUT/o.gif"), "OUT/o.gif"),
    (("build", "IN/wordless", "-o", "OUT/none/me.h5"), "OUT/none"),
    (("build", "IN/wordless", "-o", "OUT"), "OUT"),
    (("align", *LINE, "-o", "OUT/none/o.TextGrid"), "OUT/none"),
    (("align", *LINE, "-o", "OUT/o.txt"), "OUT/o.txt"),
    (("align", *LINE, "-o", "OUT/o.xyz"), "OUT/o.xyz"),
    (("inspect", "IN/db.h5", "--plots", "OUT/none/deeper"), "OUT/none/deeper"),
    (("inspect", "IN/db.h5", "--plots", "IN/words.txt"), "IN/words.txt"),
    (("evaluate", "IN/db.h5", "IN/mute", "--plots", "OUT/none/deeper"), "OUT/none/deeper"),
    # Footage and sound
    (_synth(more=("--audio", "IN/missing.wav")), "IN/missing.wav"),
    (_synth(more=("--audio", "IN/words.txt")), "IN/words.txt"),
    (_synth(more=("--audio", "IN/mute/clip.mp4")), "IN/mute/clip.mp4"),
    (_synth(more=("--background", "IN/missing.mp4")), "IN/missing.mp4"),
    (_synth(more=("--background", "IN/broken/clip.mp4")), "IN/broken/clip.mp4"),
    (_synth(more=("--background", "IN/good.TextGrid")), "IN/good.TextGrid"),
    (("align", "IN/mute/clip.mp4", "IN/words.txt", "-o", "OUT/o.lab"), "IN/mute/clip.mp4"),
    (("align", "IN/broken/clip.mp4", "IN/words.txt", "-o", "OUT/o.lab"), "IN/broken/clip.mp4"),
    (("align", "IN/wordless/clip.mp4", "IN/empty.txt", "-o", "OUT/o.lab"), "IN/empty.txt"),
    (("align", "IN/wordless/clip.mp4", "IN/missing.txt", "-o", "OUT/o.lab"), "IN/missing.txt"),
    # Corpora
    (("build", "IN/missing", "-o", "OUT/me.h5"), "IN/missing"),
    (("build", "IN/words.txt", "-o", "OUT/me.h5"), "IN/words.txt"),
    (("build", "IN/void", "-o", "OUT/me.h5"), "IN/void"),
    (("build", "IN/broken", "-o", "OUT/me.h5"), "IN/broken/clip.mp4"),
    (("build", "IN/wordless", "-o", "OUT/me.h5", "--exclude", "clib"), "'clib'"),
    (("build", "IN/wordless", "-o", "OUT/me.h5", "--exclude", "clip"), "IN/wordless"),
    (("build", "IN/wordless", "-o", "OUT/me.h5", "--dictionary", "IN/no.dict"), "IN/no.dict"),
    (("evaluate", "IN/db.h5", "IN/missing"), "IN/missing"),
    (("evaluate", "IN/db.h5", "IN/void"), "IN/void"),
    # Arguments
    ((), "unitsel --help"),
    (("frobnicate",), "'frobnicate'"),
    (("build",), "CORPUS"),
    (("build", "IN/mute"), "-o"),
    (("build", "IN/mute", "-o", "OUT/me.h5", "--jobs", "0"), "--jobs: '0'"),
    (("build", "IN/mute", "-o", "OUT/me.h5", "--limit", "-1"), "--limit: '-1'"),
    (("build", "IN/mute", "-o", "OUT/me.h5", "--focal", "inf"), "--focal: 'inf'"),
    (("build", "IN/mute", "-o", "OUT/me.h5", "--codec", "gif"), "--codec"),
    (("build", "IN/mute", "-o", "OUT/me.h5", "--codec", "avif:0"), "1 to 100, as in avif:85"),
    (_synth(more=("--fps", "0")), "--fps: '0'"),
    (_synth(more=("--fps", "nan")), "--fps: 'nan'"),
    (_synth(more=("--colour", "red")), "--colour"),
    # Footage that must be looked at
    (("build", "IN/mute", "-o", "OUT/me.h5", "--jobs", "1"), "IN/mute/clip.mp4"),
    (("build", "IN/wordless", "-o", "OUT/me.h5", "--jobs", "1"), "IN/wordless/clip.mp4"),
    (("evaluate", "IN/db.h5", "IN/faceless"), "IN/faceless/clip.mp4"),
    (("evaluate", "IN/db.h5", "IN/mute"), "IN/mute/clip.mp4"),
    (_synth(more=("--background", "IN/faceless/clip.mp4")), "IN/faceless/clip.mp4"),
    # Speech
    (_say("a", "--voice", "nosuchvoice"), "voice 'nosuchvoice'"),
    (_say("?! ... -"), "holds nothing that voice 'en-us' can say"),
    (_say("a", "--background", "IN/faceless/clip.mp4"), "IN/faceless/clip.mp4"),
    (("dub", "IN/db.h5", "IN/mute/clip.mp4", "IN/words.txt", "-o", "OUT/o.mp4"), "IN/mute/clip"),
    (("dub", "IN/db.h5", "IN/wordless/clip.mp4", "IN/dots.txt", "-o", "OUT/o.mp4"), "IN/dots.txt"),
    (
        ("dub", "IN/db.h5", "IN/wordless/clip.mp4", "IN/empty.lab", "-o", "OUT/o.mp4"),
        "IN/empty.lab",
    ),
]


def _name(value: object) -> str:
    return (" ".join(value) or "nothing") if isinstance(value, tuple) else ""


def _check(
    arguments: tuple[str, ...],
    named: str,
    inputs: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def placed(text: str) -> str:
        return text.replace("IN/", f"{inputs}/").replace("OUT", str(tmp_path))

    before = sorted(inputs.rglob("*"))
    command = [placed(a) for a in arguments]
    for as_json in (False, True):
        status = main([*command, "--json"] if as_json else command)
        out, err = capsys.readouterr()
        assert status == 2, (out, err)
        assert err.startswith("unitsel: ") and err.count("\n") == 1, err
        assert "Traceback" not in err and "unexpected" not in err
        assert placed(named) in err
        assert out == ("" if not as_json else json.dumps({"error": err[9:-1]}) + "\n")
    assert list(tmp_path.iterdir()) == []
    assert sorted(inputs.rglob("*")) == before


@pytest.mark.parametrize(("arguments", "named"), BAD, ids=_name)
def test_bad_input_is_told_in_one_line(
    arguments: tuple[str, ...],
    named: str,
    inputs: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if "say" in arguments:
        pytest.importorskip("espeakng_loader", reason="needs the optional extra `espeak`")
    _check(arguments, named, inputs, tmp_path, capsys)


def test_a_corpus_without_a_face(
    inputs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "me.h5"
    assert main(["build", str(inputs / "faceless"), "-o", str(output), "--jobs", "1"]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "no face" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["build", "synth", "align"])
def test_what_stood_at_the_output_is_still_there(
    kind: str,
    inputs: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    output = tmp_path / {"build": "me.h5", "synth": "o.mp4", "align": "o.lab"}[kind]
    output.write_bytes(b"precious")
    command = {
        "build": ("build", inputs / "mute", "--jobs", "1"),
        "synth": (
            *("synth", inputs / "db.h5", inputs / "good.TextGrid"),
            *("--background", inputs / "faceless/clip.mp4"),
        ),
        "align": ("align", inputs / "wordless/clip.mp4", inputs / "empty.txt"),
    }[kind]
    assert main([*map(str, command), "-o", str(output)]) == 2
    assert output.read_bytes() == b"precious"
    assert [p.name for p in tmp_path.iterdir()] == [output.name]


def test_a_real_process_says_the_same(inputs: Path, tmp_path: Path) -> None:
    """Nothing that the libraries print on their own reaches the terminal either."""
    done = subprocess.run(
        [
            *(sys.executable, "-m", "unitsel", "synth", inputs / "db.h5"),
            *(inputs / "good.TextGrid", "--background", inputs / "broken/clip.mp4"),
            *("-o", tmp_path / "o.mp4", "--json"),
        ],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert done.stderr.startswith(f"unitsel: {inputs / 'broken/clip.mp4'}: ")
    assert done.stderr.count("\n") == 1
    assert json.loads(done.stdout) == {"error": done.stderr[9:-1]}
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_may_not_be_written(
    inputs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o555)
    for command in (
        ("align", inputs / "wordless/clip.mp4", inputs / "words.txt", "-o", closed / "o.lab"),
        ("inspect", inputs / "db.h5", "--plots", closed / "plots"),
    ):
        assert main([str(a) for a in command]) == 2
        assert str(closed) in capsys.readouterr().err


def test_a_reader_that_goes_away_is_no_error(inputs: Path) -> None:
    shell = shutil.which("sh")
    if shell is None:
        pytest.skip("needs a shell")
    done = subprocess.run(
        [shell, "-c", f'"{sys.executable}" -m unitsel inspect "{inputs}/db.h5" | true'],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.stderr == ""
