"""Phones in time: a clip's sound aligned to its words by pocketsphinx.

Two passes, as pocketsphinx wants it: the words first, then the phones inside them. The
recogniser gives up on about one clip in twenty at its own beams and on digital silence always,
so every attempt pads the sound and adds a faint noise; later ones change both and search wider.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt

from analysis.alignment import (
    FRAME_SECONDS,
    AlignedPhone,
    Alignment,
    Word,
    as_alignment,
    is_silence,
    reaching,
    untangled,
)
from analysis.g2p import with_guesses
from database.errors import AlignmentError, PronunciationError
from database.lexicon import Lexicon
from database.sound import Sound
from database.timing.words import WordTrack, clean_word

RATE = 16000
"""Sampling rate of the acoustic model, 1/s."""


@dataclass(frozen=True)
class Attempt:
    """One way to try.

    Parameters
    ----------
    beam, word_beam : float
        Pruning of states and of word exits; smaller is wider.
    pad : float
        Seconds of faint noise put before and after the sound.
    dither : float
        Standard deviation of the noise, in 16-bit steps.
    """

    beam: float
    word_beam: float
    pad: float
    dither: float


@dataclass(frozen=True)
class AlignSettings:
    """How to align.

    Parameters
    ----------
    attempts : sequence of Attempt
        Tried in order until one succeeds.
    tolerance : float
        Seconds by which a word may leave the bounds given for it before it is searched again
        inside them.
    cue_tolerance : float
        The same for the words of a cue: subtitles come and go by the reader's needs.
    """

    attempts: tuple[Attempt, ...] = (
        # A longer pad rescues what a wider beam alone does not: the second pass must end in
        # silence.
        Attempt(1e-48, 7e-29, 0.3, 3.0),
        Attempt(1e-48, 7e-29, 0.5, 30.0),
        Attempt(1e-90, 1e-60, 0.3, 3.0),
        Attempt(1e-48, 7e-29, 0.1, 3.0),
        Attempt(1e-150, 1e-120, 0.5, 30.0),
    )
    tolerance: float = 0.08
    cue_tolerance: float = 0.4


class Aligner:
    """Aligns sounds to words; keeps its recognisers, so use one for many clips.

    Parameters
    ----------
    lexicon : Lexicon, optional
        Pronunciations; by default those of the CMU dictionary.
    settings : AlignSettings, optional
    """

    def __init__(
        self, lexicon: Lexicon | None = None, settings: AlignSettings | None = None
    ) -> None:
        self.lexicon = lexicon or Lexicon.default()
        self.settings = settings or AlignSettings()
        self._decoders: dict[tuple[float, float], Any] = {}
        self._added: set[tuple[tuple[float, float], str]] = set()
        self._guesses: dict[str, str] = {}

    def align(self, sound: Sound, words: Sequence[str], *, name: str = "sound") -> Alignment:
        """Phones of a sound whose words are known.

        Parameters
        ----------
        sound : Sound
            16 kHz mono.
        words : sequence of str
        name : str
            For messages: the clip.

        Raises
        ------
        PronunciationError
            If a word is in no dictionary.
        AlignmentError
            If no attempt succeeds.
        """
        samples = _checked(sound, words, name)
        notes = self._pronounceable(words, name)
        found, attempts = self._search(samples, words, name)
        if attempts > 1:
            notes.append(f"aligned at attempt {attempts}")
        return as_alignment(found, len(samples) / RATE, attempts, tuple(notes), name)

    def align_bounded(self, sound: Sound, words: WordTrack, *, name: str = "sound") -> Alignment:
        """Phones of a sound whose words and their times are known.

        The sentence is aligned as a whole; a word that comes to lie outside its bounds is
        searched again inside them, and beside silence a word reaches to its bounds. Where the
        recogniser fails, the dictionary's phones share the word's time, and a note says so.
        Of words that share a cue (`WordTrack.cues`) only the cue's ends are bounds: where one
        of them lies beyond, all of the cue are searched again inside it.

        Raises
        ------
        PronunciationError
            If a word is in no dictionary.
        AlignmentError
            If the sound is too short, or no word lies inside it.
        """
        samples = _checked(sound, words.words, name)
        duration = len(samples) / RATE
        notes = self._pronounceable(words.words, name)
        try:
            whole, attempts = self._search(samples, words.words, name)
            if attempts > 1:
                notes.append(f"aligned at attempt {attempts}")
        except AlignmentError:
            whole, attempts = [(w, []) for w in words.words], len(self.settings.attempts)
            notes.append("no attempt aligned the whole sentence; its words were aligned one by one")
        spoken = [w for w in whole if w[0]]
        if words.cues:
            spoken = self._inside_cues(samples, spoken, words, name, notes)
        found: list[Word] = []
        slack = self.settings.tolerance
        for (word, phones), start, end in zip(spoken, words.starts, words.ends, strict=True):
            if words.cues and phones:
                found.append((word, phones))
                continue
            low, high = float(start), min(float(end), duration)
            if high - low < 2 * FRAME_SECONDS:
                notes.append(f"word {word!r} at {low:.2f} s lies outside the sound; left out")
                continue
            if not phones or phones[0].start < low - slack or phones[-1].end > high + slack:
                phones = self._inside(samples, word, low, high, name, notes)
            found.append((word, reaching(phones, low, high, words)))
        return as_alignment(untangled(found), duration, attempts, tuple(notes), name)

    def _inside_cues(
        self,
        samples: npt.NDArray[np.float32],
        spoken: list[Word],
        words: WordTrack,
        name: str,
        notes: list[str],
    ) -> list[Word]:
        """Words of which those of a cue lie inside it; without phones where they are not heard."""
        out: list[Word] = []
        slack = self.settings.cue_tolerance
        for _, group in groupby(range(len(spoken)), key=lambda i: words.cues[i]):
            places = list(group)
            here = spoken[places[0] : places[-1] + 1]
            low = max(words.starts[places[0]] - slack, 0.0)
            high = min(words.ends[places[-1]] + slack, len(samples) / RATE)
            if all(p and p[0].start >= low and p[-1].end <= high for _, p in here):
                out += here
                continue
            said = [word for word, _ in here]
            part = Sound(samples[round(low * RATE) : round(high * RATE)], RATE)
            try:
                heard = self._search(_checked(part, said, name), said, name)[0]
            except AlignmentError:
                notes.append(f"the cue {' '.join(said)[:40]!r} at {low:.2f} s was not heard")
                heard = [(word, []) for word in said]
            out += [
                (word, [AlignedPhone(low + p.start, low + p.end, p.symbol) for p in phones])
                for word, phones in heard
                if word
            ]
        return out

    def _inside(
        self,
        samples: npt.NDArray[np.float32],
        word: str,
        low: float,
        high: float,
        name: str,
        notes: list[str],
    ) -> list[AlignedPhone]:
        """A word's phones inside its bounds; spread evenly, and noted, if it is not heard there."""
        part = samples[round(low * RATE) : round(high * RATE)]
        try:
            found, _ = self._search(part, [word], name)
            phones = [p for w, ps in found if w for p in ps]
            return [AlignedPhone(low + p.start, low + p.end, p.symbol) for p in phones]
        except AlignmentError:
            notes.append(f"word {word!r} at {low:.2f} s was not heard; its phones share its time")
            symbols = self.lexicon.arpabet(word)[0]
            edges = np.linspace(low, high, len(symbols) + 1)
            return [
                AlignedPhone(float(edges[i]), float(edges[i + 1]), s) for i, s in enumerate(symbols)
            ]

    def _pronounceable(self, words: Sequence[str], name: str) -> list[str]:
        """Notes on the words whose pronunciation is a guess, made where a dictionary has none."""
        missing = self.lexicon.missing(words)
        if missing:
            self.lexicon, guesses = with_guesses(self.lexicon, missing)
            self._guesses.update(guesses)
            missing = self.lexicon.missing(missing)
        if missing:
            raise PronunciationError(
                f"{name}: no pronunciation for {', '.join(missing)}; give one in a dictionary file "
                "(WORD PHONES a line, --dictionary FILE), or install the optional extra `espeak`"
            )
        # For every clip that says the word, whichever was first: reports must not depend on order.
        return [self._guesses[w] for w in dict.fromkeys(words) if w in self._guesses]

    def _search(
        self, samples: npt.NDArray[np.float32], words: Sequence[str], name: str
    ) -> tuple[list[Word], int]:
        for number, attempt in enumerate(self.settings.attempts, 1):
            found = self._try(samples, words, attempt)
            if found is not None:
                return found, number
        raise AlignmentError(
            f"{name}: the words {' '.join(words)!r} could not be aligned to the sound in "
            f"{len(self.settings.attempts)} attempts; are they what is spoken?"
        )

    def _try(
        self, samples: npt.NDArray[np.float32], words: Sequence[str], attempt: Attempt
    ) -> list[Word] | None:
        decoder = self._decoder(attempt)
        names = [self._known(decoder, attempt, w) for w in words]
        data = _prepared(samples, attempt)
        try:
            # The recogniser goes on from the last sound's mean; clips must not depend on order.
            decoder.reinit_feat()
            decoder.set_align_text(" ".join(names))
            _decode(decoder, data)
            segments = decoder.seg()
            if segments is None:
                return None
            said = [_bare(s.word) for s in segments if not is_silence(s.word)]
            if said != names:
                return None
            decoder.set_alignment()
            _decode(decoder, data)
            alignment = decoder.get_alignment()
        except RuntimeError:
            return None
        if alignment is None:
            return None
        spoken = iter(words)
        found: list[Word] = []
        end_of_sound = len(samples) / RATE
        for w in alignment:
            label = "" if is_silence(w.name) else next(spoken, "")
            phones = []
            for p in w:
                first = p.start * FRAME_SECONDS - attempt.pad
                last = first + p.duration * FRAME_SECONDS
                start, end = (min(max(t, 0.0), end_of_sound) for t in (first, last))
                if end > start:
                    phones.append(AlignedPhone(start, end, p.name))
            if label and not phones:
                return None
            found.append((label, phones))
        return found if next(spoken, None) is None else None

    def _decoder(self, attempt: Attempt) -> Any:
        key = (attempt.beam, attempt.word_beam)
        if key not in self._decoders:
            import pocketsphinx  # Slow to load, and not needed where timing files exist.

            self._decoders[key] = pocketsphinx.Decoder(
                lm=None,
                loglevel="FATAL",
                beam=attempt.beam,
                pbeam=attempt.beam,
                wbeam=attempt.word_beam,
            )
        return self._decoders[key]

    def _known(self, decoder: Any, attempt: Attempt, word: str) -> str:
        """The recogniser's name for a word, taught to it where its dictionary says otherwise."""
        name = clean_word(word.lower())
        variants = [" ".join(symbols) for symbols in self.lexicon.arpabet(word)]
        if decoder.lookup_word(name) in variants:
            return name
        own = f"{name}_own"
        key = ((attempt.beam, attempt.word_beam), own)
        if key not in self._added:
            for i, phones in enumerate(variants):
                decoder.add_word(own if i == 0 else f"{own}({i + 1})", phones, True)
            self._added.add(key)
        return own


def _checked(sound: Sound, words: Sequence[str], name: str) -> npt.NDArray[np.float32]:
    if sound.rate != RATE:
        raise AlignmentError(f"{name}: the sound must be sampled at {RATE} Hz, not {sound.rate}")
    if len(words) == 0:
        raise AlignmentError(f"{name}: there are no words to align")
    if len(sound.samples) < RATE // 10:
        raise AlignmentError(f"{name}: the sound is shorter than 0.1 s")
    return sound.samples


def _prepared(samples: npt.NDArray[np.float32], attempt: Attempt) -> bytes:
    pad = round(attempt.pad * RATE)
    scaled = np.pad(np.nan_to_num(samples.astype(np.float64)) * 32767, pad)
    # A fixed seed: the same clip is aligned the same way in every build.
    scaled += np.random.default_rng(0).normal(0, attempt.dither, len(scaled))
    return np.clip(np.round(scaled), -32768, 32767).astype("<i2").tobytes()


def _decode(decoder: Any, data: bytes) -> None:
    decoder.start_utt()
    try:
        decoder.process_raw(data, full_utt=True)
    finally:
        decoder.end_utt()


def _bare(word: str) -> str:
    """A word without the number of its variant: ``a(2)`` is ``a``."""
    return word[: word.index("(")] if word.endswith(")") and "(" in word else word
