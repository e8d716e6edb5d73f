"""What holds for every timing reader and all bytes; run by Hypothesis and by Atheris alike.

Bytes are read as a timing (or as words), or they are one `TimingError` of one line that names the
file. What was read is sound, can be written in every format or is refused by a `TimingError`, and
comes back from a TextGrid. Neither takes long.
"""

from __future__ import annotations

import math
import time
from pathlib import Path

from database.errors import TimingError
from database.timing import FORMATS, Timing, WordTrack, parse_timing, timing_extensions
from database.timing.tiers import MAX_SECONDS
from database.timing.words import parse_words
from database.track import PhonemeTrack

SEEDS = Path(__file__).parent.parent / "data" / "timing"
"""Valid files of all formats."""

EXTENSIONS = (*timing_extensions(), ".txt")
CPU_SECONDS = 2.0
"""For at most 64 KiB; the usual is a thousandth of it."""


def check_file(extension: str, data: bytes, *, writing: bool = True) -> str:
    """Check one file's bytes; gives the error's message, or nothing if they were read.

    Parameters
    ----------
    extension : str
    data : bytes
    writing : bool
        Whether what was read is also written in every format.

    Raises
    ------
    AssertionError
        Where the property does not hold; any other exception is a defect of a reader too.
    """
    began = time.process_time()
    path = f"any{extension}"
    message = ""
    try:
        if extension == ".txt":
            words = parse_words(path, data)
            assert words and all(len(w.split()) == 1 for w in words)
        else:
            timing = parse_timing(path, data)
            _check_sound(timing)
            if writing:
                _check_writing(timing)
    except TimingError as error:
        message = str(error)
        assert message.startswith(f"{path}: "), message
        assert len(message.splitlines()) == 1, message
        assert len(message) < 600, message
        assert message.isprintable(), message
    assert time.process_time() - began < CPU_SECONDS
    return message


def check_tagged(data: bytes) -> None:
    """Check bytes of which the first chooses the extension."""
    if data:
        check_file(EXTENSIONS[data[0] % len(EXTENSIONS)], data[1:])


def seed_files() -> dict[str, bytes]:
    """The seeds as `check_tagged` takes them, by name."""
    return {
        f.name: bytes([EXTENSIONS.index(f.suffix.lower())]) + f.read_bytes()
        for f in sorted(SEEDS.iterdir())
    }


def _check_sound(timing: Timing) -> None:
    assert math.isfinite(timing.end) and 0 < timing.end <= MAX_SECONDS
    if timing.phones is not None:
        steps = [i.end - i.start for i in timing.phones.intervals()]
        assert timing.phones.start == 0 and min(steps) > 0
    if timing.words is not None:
        spans = timing.words.intervals()
        assert all(0 <= i.start < i.end <= timing.words.duration for i in spans)


def _check_writing(timing: Timing) -> None:
    for form in FORMATS:
        try:
            text = form.write(timing)
        except TimingError as error:
            assert len(str(error).splitlines()) == 1
            continue
        assert text.endswith("\n")
        data = text.encode(form.encoding)  # no lone surrogates
        if form.name in ("textgrid", "mfa-json"):
            again = parse_timing(f"again{form.extensions[0]}", data)
            for ours, theirs in ((timing.phones, again.phones), (timing.words, again.words)):
                assert _labels(ours) == _labels(theirs), form.name


def _labels(track: PhonemeTrack | WordTrack | None) -> list[str]:
    """Labels of a track; of phones without silence at the end, which the words may outlast."""
    labels = [i.label for i in track.intervals()] if track else []
    while labels and labels[-1] == "sil" and isinstance(track, PhonemeTrack):
        labels.pop()
    return labels
