"""What is said, as phonemes in time: from sound and words, or from a timing file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from analysis.align import Aligner
from analysis.alignment import Alignment
from analysis.g2p import speaking_lexicon, with_guesses
from database.errors import PronunciationError, TimingError
from database.lexicon import spread_words
from database.phonemes import SILENCE
from database.sound import read_sound
from database.timing import Timing, read_timing, read_words
from database.track import Interval, PhonemeTrack

SAME_LENGTH: Final = 0.2
"""Seconds that a sound and its timings may differ by unmentioned: half a pause."""


def align_media(
    media: str | Path, words: str | Path, *, dictionary: str | Path | None = None
) -> Alignment:
    """Align the sound of a media file to its words.

    Parameters
    ----------
    media : path
        Video or sound file.
    words : path
        The words: a text, or a timing file with words, whose times then bound the search.
    dictionary : path, optional
        Pronunciations to add to the CMU dictionary's.

    Raises
    ------
    MediaError, TimingError, PronunciationError, AlignmentError
        Naming what cannot be read or aligned.
    """
    aligner = Aligner(speaking_lexicon(dictionary))
    script = Path(words)
    with _naming(script):
        if script.suffix.lower() == ".txt":
            return aligner.align(read_sound(media), read_words(script), name=Path(media).name)
        try:
            timing = read_timing(script)
        except TimingError:
            if script.suffix.lower() != ".lab":
                raise
            return aligner.align(read_sound(media), read_words(script), name=Path(media).name)
        if timing.words is None:
            raise TimingError(f"{script}: holds phones but no words; there is nothing to align")
        return aligner.align_bounded(read_sound(media), timing.words, name=Path(media).name)


def track_of_timing(
    timing: Timing,
    *,
    audio: str | Path | None = None,
    dictionary: str | Path | None = None,
    name: str = "timing",
) -> PhonemeTrack:
    """The phonemes of a timing file, whatever it holds.

    Phones are taken as they stand. Words become phones: aligned to the sound where there is
    one, else the dictionary's, sharing each word's time. With sound, silence is added up to
    its end.

    Parameters
    ----------
    timing : Timing
    audio : path, optional
    dictionary : path, optional
    name : str
        For messages.
    """
    sound = None if audio is None else read_sound(audio)
    if timing.phones is not None:
        track = timing.phones
    elif timing.words is None:
        raise TimingError(f"{name}: holds neither phones nor words")
    else:
        lexicon = speaking_lexicon(dictionary)
        with _naming(name):
            if sound is not None:
                track = Aligner(lexicon).align_bounded(sound, timing.words, name=name).track
            else:
                spoken, _ = with_guesses(lexicon, timing.words.words)
                track = spread_words(timing.words, spoken)
    return track if sound is None else lengthened(track, sound.duration)


def length_note(timing: Timing, audio: str | Path) -> str | None:
    """What to tell of a sound that is shorter or longer than its timings; None if it fits.

    Raises
    ------
    MediaError
        If the sound cannot be read.
    """
    if timing.phones is not None:
        end = timing.phones.end
    elif timing.words is not None:
        end = timing.words.duration
    else:
        return None
    duration = read_sound(audio).duration
    if abs(duration - end) <= SAME_LENGTH:
        return None
    rest = "the rest is silent" if duration < end else "the mouth rests till its end"
    return f"{audio}: lasts {duration:.2f} s, and the timings end at {end:.2f} s; {rest}"


@contextmanager
def _naming(script: str | Path) -> Iterator[None]:
    """Say which file the word stands in that cannot be pronounced."""
    try:
        yield
    except PronunciationError as error:
        raise PronunciationError(f"{script}: {error}") from error


def lengthened(track: PhonemeTrack, duration: float) -> PhonemeTrack:
    """A track that lasts at least `duration` seconds, with silence at its end."""
    if track.end >= duration - 1e-3:
        return track
    intervals = track.intervals()
    if track.phonemes[-1] == SILENCE:
        intervals[-1] = Interval(intervals[-1].start, duration, "sil")
    else:
        intervals.append(Interval(track.end, duration, "sil"))
    return PhonemeTrack.from_intervals(intervals, name=track.name)
