"""The options of synth, say and dub that say how a video is written, and disks that fill up."""

from __future__ import annotations

import json
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import av
import numpy as np
import pytest
from PIL import Image

from database.media import probe
from database.timing import Timing, write_timing
from database.track import PhonemeTrack
from unitsel.pieces import LONG, pieces

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def timing(puppet: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("timing") / "say.TextGrid"
    write_timing(path, Timing(puppet.even_track("set blue", 0.1, 0.3)[0], None))
    return path


def test_options_reach_the_file(run: Run, puppet_db: Path, timing: Path, tmp_path: Path) -> None:
    path = tmp_path / "o.webm"
    options = ("--codec", "av1", "--crf", 40, "--size", "576x704", "--comment", "try it")
    status, out, err = run("synth", puppet_db, timing, "-o", path, *options, "--json")
    assert (status, err) == (0, ""), err
    assert json.loads(out)["video"] == str(path)
    info = probe(path)
    assert (info.width, info.height) == (576, 704)
    with av.open(str(path)) as container:
        assert container.streams.video[0].codec_context.codec.canonical_name == "av1"
        tags = {k.lower(): v for k, v in container.metadata.items()}
    assert tags["comment"] == "try it"
    assert json.loads(tags["synopsis"])["synthetic"] is True


def test_pictures_with_alpha_go_to_a_folder(
    run: Run, puppet_db: Path, timing: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "mouth"
    status, out, err = run("synth", puppet_db, timing, "-o", folder, "--alpha", "--json")
    assert (status, err) == (0, ""), err
    pictures = sorted(folder.iterdir())
    assert len(pictures) == json.loads(out)["frames"]
    picture = np.asarray(Image.open(pictures[0]))
    assert picture.shape[2] == 4
    assert 0.005 < (picture[..., 3] > 0).mean() < 0.3


@pytest.mark.parametrize(
    ("output", "options", "says"),
    [
        ("o.mp4", ["--alpha"], "holds no transparency"),
        ("o.webm", ["--codec", "h264"], "choose vp9 or av1"),
        ("o.mp4", ["--crf", "77"], "CRF goes from 0 to 51"),
        ("o.mp4", ["--crf", "-1"], "--crf"),
        ("o.mp4", ["--size", "100"], "not a size such as"),
        ("o.mp4", ["--size", "100x10"], "of the same shape, such as"),
        ("frames", ["--crf", "3"], "no codec and no CRF"),
        ("o.gif", [], "give it one of the extensions"),
    ],
)
def test_what_does_not_go_together_is_told_in_one_line(
    output: str,
    options: list[str],
    says: str,
    run: Run,
    puppet_db: Path,
    timing: Path,
    tmp_path: Path,
) -> None:
    status, out, err = run("synth", puppet_db, timing, "-o", tmp_path / output, *options)
    assert (status, out) == (2, "")
    assert says in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@contextmanager
def small_disk(size: int) -> Iterator[None]:
    """No file can grow beyond a size, as on a disk that is full then."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("output", ["o.mp4", "frames"])
def test_a_disk_that_fills_up_is_told_and_leaves_nothing(
    output: str, run: Run, puppet_db: Path, timing: Path, tmp_path: Path
) -> None:
    with small_disk(6000):
        status, out, err = run("synth", puppet_db, timing, "-o", tmp_path / output)
    assert (status, out) == (2, "")
    assert f"{output}: cannot be written (" in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_long_timing_goes_utterance_by_utterance(
    run: Run, puppet_db: Path, puppet: ModuleType, tmp_path: Path
) -> None:
    one = puppet.even_track("set blue now", 0.1, 0.3)[0]
    n = int(1.3 * LONG / one.end)
    bounds = np.concatenate([[0.0], *(one.boundaries[1:] + i * one.end for i in range(n))])
    track = PhonemeTrack(np.tile(one.phonemes, n), bounds)
    assert len(pieces(track)) > 1
    write_timing(tmp_path / "long.TextGrid", Timing(track, None))
    path = tmp_path / "o.mp4"
    status, out, err = run("synth", puppet_db, tmp_path / "long.TextGrid", "-o", path, "--json")
    assert (status, err) == (0, ""), err
    document = json.loads(out)
    assert document["frames"] == round(track.end * 25) == probe(path).frames
    assert 1 < document["segments"] < document["frames"]
    assert document["cost"] > 0
