"""Speech made of text: its sound, its phonemes and words in time, and what was approximated."""

from __future__ import annotations

import os
import tempfile
import wave
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.align import Aligner
from analysis.espeak import find_voice, sample_rate
from analysis.g2p import speaking_lexicon
from analysis.utterance import Utterance, say
from database.errors import PronunciationError, SpeechError, TrackError
from database.pinyin import TimedSyllable
from database.sound import SPEECH_RATE, Sound, read_sound, resampled
from database.timing.words import WordTrack, clean_word
from database.track import Interval, PhonemeTrack
from database.voice_symbols import Rendering, render_intervals
from unitsel.speech.command import run_command
from unitsel.speech.mandarin import (
    IN_PINYIN,
    MISSING,
    Word,
    can_read,
    is_mandarin,
    spelled,
    timed_syllables,
    told,
    words_of,
)
from unitsel.speech.text import checked_text

DEFAULT_VOICE: Final = "en-us"
ESPEAK: Final = "espeak"

LEAD, TAIL = 0.2, 0.3
"""Seconds of silence before and after what espeak says: a person begins and ends at rest."""

SHORTEST: Final = 1e-4
"""Seconds; espeak gives some phonemes no time at all."""

SHORTEST_PAUSE: Final = 0.03
"""Seconds; what is shorter is no rest for the lips, but the end of the phone before."""


@dataclass(frozen=True)
class Speech:
    """A text that was spoken.

    Parameters
    ----------
    sound : Sound or Path
        What is heard: samples, or the file that `speak` was told to write.
    track : PhonemeTrack
        From 0 to the sound's end.
    words : WordTrack or None
    approximated : tuple of Rendering
        Symbols of the voice that English lacks, each with the phonemes that it is shown as.
    notes : tuple of str
        What else there is to say: pronunciations that were guessed.
    syllables : tuple of TimedSyllable
        Mandarin's, of all words that Pinyin has.
    """

    sound: Sound | Path
    track: PhonemeTrack
    words: WordTrack | None
    approximated: tuple[Rendering, ...] = field(default=())
    notes: tuple[str, ...] = field(default=())
    syllables: tuple[TimedSyllable, ...] = field(default=())

    def heard(self) -> Sound:
        """The sound as guides hear it: 16 000 samples a second."""
        if isinstance(self.sound, Sound):
            return resampled(self.sound, SPEECH_RATE)
        return read_sound(self.sound)


def speak(
    text: str,
    *,
    voice: str | None = None,
    rate: float | None = None,
    tts: str = ESPEAK,
    wav: str | Path | None = None,
    dictionary: str | Path | None = None,
) -> Speech:
    """Speak a text, and tell when which phoneme is said.

    Parameters
    ----------
    text : str
        One sentence or many. Numbers and abbreviations are read as the voice reads them.
    voice : str, optional
        One of espeak's, ``en-us`` by default: a language, a name or a file, with a variant behind a
        plus sign (``el+f2``). For a command, what stands for ``{voice}``.
    rate : float, optional
        Words a minute: 80 to 450, about 175 by default. For a command, ``{rate}``.
    tts : str
        "espeak"; a command (`unitsel.speech.command`); or a sound file in which these words are
        spoken. The sounds of the last two are aligned to the text, in English.
    wav : path, optional
        Write the sound there, piece by piece, and do not hold it: for long texts. Not there
        before it is complete.
    dictionary : path, optional
        Pronunciations to add to the CMU dictionary's, for the alignment.

    Returns
    -------
    Speech

    Raises
    ------
    SpeechError
        If there is nothing to say, no such voice, no espeak, or the command fails.
    MediaError, PronunciationError, AlignmentError
        If a recording cannot be read or does not fit the text.
    """
    text = checked_text(text)
    if tts == ESPEAK:
        return _by_espeak(text, voice or DEFAULT_VOICE, rate, None if wav is None else Path(wav))
    if "{" not in tts:
        if not Path(tts).is_file():
            raise SpeechError(
                f"--tts {tts}: is neither espeak, nor a sound file that is there, nor a command "
                "with {wav} where the file is that it writes"
            )
        for name, value in (("voice", voice), ("rate", rate)):
            if value is not None:
                raise SpeechError(f"--{name} changes nothing in a recording ({tts}); leave it out")
        if wav is not None:
            raise SpeechError(f"{tts}: is a recording already; no other sound is written")
        return aligned_speech(Path(tts), text, dictionary=dictionary)
    if wav is None:
        with tempfile.TemporaryDirectory(prefix="unitsel-") as folder:
            made = Path(folder) / "speech.wav"
            run_command(tts, text, made, voice=voice, rate=rate)
            spoken = aligned_speech(made, text, dictionary=dictionary)
            return Speech(read_sound(made, None), spoken.track, spoken.words, (), spoken.notes)
    with _beside(Path(wav)) as partial:
        run_command(tts, text, partial, voice=voice, rate=rate)
        spoken = aligned_speech(partial, text, dictionary=dictionary)
    return Speech(Path(wav), spoken.track, spoken.words, (), spoken.notes)


def aligned_speech(
    sound: Path, text: str, *, dictionary: str | Path | None = None, name: str = "text"
) -> Speech:
    """A recording of a text, in English.

    Raises
    ------
    SpeechError
        If the text holds no word.
    MediaError, PronunciationError, AlignmentError
        If the sound cannot be read, a word not be pronounced, or the two do not fit.
    """
    words = [w for token in text.split() if (w := clean_word(token))]
    if not words:
        raise SpeechError(f"{name}: holds punctuation only; there is nothing to say")
    aligner = Aligner(speaking_lexicon(dictionary))
    try:
        found = aligner.align(read_sound(sound), words, name=sound.name)
    except PronunciationError as error:
        raise PronunciationError(f"{name}: {error}") from error
    return Speech(sound, found.track, found.words, (), found.notes)


def _by_espeak(text: str, voice: str, rate: float | None, wav: Path | None) -> Speech:
    samples = sample_rate()
    identifier = find_voice(voice)
    chinese: tuple[Word, ...] = ()
    unread = is_mandarin(identifier) and not can_read()
    if is_mandarin(identifier) and not unread:
        # Given as Pinyin, so that what is heard is what the lips show.
        chinese = words_of(text)
        text, in_pinyin = spelled(chinese)
        if in_pinyin:
            voice = IN_PINYIN + "".join(identifier.partition("+")[1:])
    if wav is None:
        pieces: list[npt.NDArray[np.int16]] = []
        said = _say(text, voice, rate, pieces.append, samples)
        sound: Sound | Path = Sound(
            np.concatenate(pieces).astype(np.float32) / np.float32(32768), samples
        )
    else:
        with _beside(wav) as partial:
            try:
                with wave.open(str(partial), "wb") as file:
                    file.setnchannels(1)
                    file.setsampwidth(2)
                    file.setframerate(samples)
                    said = _say(text, voice, rate, lambda p: file.writeframes(p.tobytes()), samples)
            except (OSError, wave.Error) as error:
                why = getattr(error, "strerror", None) or str(error)
                raise SpeechError(
                    f"{wav}: cannot be written: {why}; choose another place"
                ) from error
        sound = wav
    syllables, written, others = timed_syllables(chinese, said)
    phones, approximated = render_intervals(said.phones)
    length = LEAD + said.duration + TAIL
    spans = [Interval(0.0, LEAD, "sil")]
    spans += [Interval(i.start + LEAD, i.end + LEAD, i.label) for i in phones]
    spans.append(Interval(LEAD + said.duration, length, "sil"))
    track = PhonemeTrack.from_intervals(_joined(spans), name=voice)
    try:
        words: WordTrack | None = WordTrack.from_intervals(
            [
                Interval(w.start + LEAD, w.end + LEAD, w.label)
                for w in (written if chinese else said.words)
            ],
            duration=length,
        )
    except TrackError:
        words = None  # Nothing but signs that stand between words.
    return Speech(
        sound,
        track,
        words,
        tuple(approximated.values()),
        (MISSING,) if unread else (told(others),) if others else (),
        tuple(s.later(LEAD) for s in syllables),
    )


def _say(
    text: str,
    voice: str,
    rate: float | None,
    sink: Callable[[npt.NDArray[np.int16]], None],
    samples: int,
) -> Utterance:
    """Say a text, with its silence before and after."""
    sink(np.zeros(round(LEAD * samples), dtype=np.int16))
    said = say(text, voice, sink, rate)
    sink(np.zeros(round(TAIL * samples), dtype=np.int16))
    return said


def _joined(spans: list[Interval]) -> list[Interval]:
    """Spans without empty ones, and with each silence in one piece."""
    out: list[Interval] = []
    for span in spans:
        if span.end - span.start < SHORTEST:
            continue
        start = out[-1].end if out else span.start
        if out and out[-1].label == "sil":
            pause = out[-1].end - out[-1].start
            if span.label == "sil":
                start = out.pop().start
            elif len(out) > 1 and pause < SHORTEST_PAUSE:
                out.pop()
                out[-1] = Interval(out[-1].start, start, out[-1].label)
        out.append(Interval(start, span.end, span.label))
    return out


@contextmanager
def _beside(wav: Path) -> Iterator[Path]:
    """Give a hidden file beside the place; it is moved there if all went well."""
    if not wav.parent.is_dir():
        raise SpeechError(f"{wav}: the folder {wav.parent} does not exist; make it first")
    if wav.is_dir() or not os.access(wav.parent, os.W_OK):
        raise SpeechError(f"{wav}: cannot be written there; choose another place")
    partial = wav.with_name(f".{wav.stem}.{os.getpid()}.part.wav")
    try:
        yield partial
        partial.replace(wav)
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
