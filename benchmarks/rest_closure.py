"""Lips in silences and in p, b and m, on rendered pictures and on real ones, by one detector.

The detector is the raw face mesh on the picture; lips count as closed below a threshold between
the person's rest frames and wide open (unitsel/likeness/eye_measures.py). It looks at recordings
and at what the synthesizer renders of the same sentences: with the costs of rest and closure
(unitsel/lip_targets.py) and without, by the target costs `paper` and `mixed`. Each sentence of the
database is selected without its own recording (the guide has seen it); clips that the database was
built without, `--clips FOLDER`, are the stricter test. Three sequences that are spoiled on purpose,
one that chatters in silences, one that freezes there and one that opens in p, b and m, are rendered
too and must miss a bar.

Sentences that are typed and spoken by espeak, at three rates and with pauses that nobody recorded,
have no recording beside them: their closures are compared with those of the recordings, and their
silences, of 0.2 to 0.3 seconds, with pieces of the recorded silences that are as short.

    python benchmarks/rest_closure.py DB.h5 [--sentences 12] [--clips FOLDER] [--strips DIR]
        [--recorded-only]

`--strips` writes p, b, m and silences as pictures, a row each: real, without the costs, with them.
The database is the one named, or in UNITSEL_BENCH_DB, else out/demo.h5 that `make demo` leaves.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from analysis.align import Aligner
from analysis.corpus import align_clip, find_clips
from analysis.face import FaceFinder
from analysis.g2p import speaking_lexicon
from analysis.lips import mesh_mouth_height
from analysis.models import find_models
from database.errors import SpeechError, UnitselError
from database.mask import INNER_LIPS, OUTER_LIPS
from database.media import probe, read_video
from database.phonemes import CLOSURES
from database.planes import planes_to_rgb
from database.reader import UnitDatabase, open_database
from database.sound import read_sound
from database.track import PhonemeTrack, frame_times
from unitsel.likeness.eye_measures import (
    LONG_SILENCE,
    closed_frames,
    closure_hit_rate,
    lip_opening,
    silence_motion,
)
from unitsel.likeness.rulers import Rulers
from unitsel.lip_targets import OFF
from unitsel.select import Selection
from unitsel.settings import TargetSettings, settings_for
from unitsel.speech.spoken import speak
from unitsel.synthesizer import Synthesizer

Picture = npt.NDArray[np.uint8]

TYPED = (
    "Hello, my name is Bob. I am from Boston.",
    "Maybe we can meet at the bank? Perhaps tomorrow, before breakfast.",
    "Mom made a mushroom omelette; Peter mopped up the mess.",
    "Stop. Wait a moment. Open the box, and tell me what you see.",
)
RATES = (140, 175, 210)
"""Words a minute; 175 is espeak's own."""

SILENCE_BAR = (0.3, 1.0)
CLOSURE_BAR = 0.05

PIECE = 0.3
"""Seconds of the pieces of recorded silences that espeak's short ones are compared with."""

TILE = 96
"""Pixels of a tile of a strip."""
COLUMNS = 14


@dataclass(frozen=True)
class Sentence:
    """What is said, whose recording may not be used, and the recording."""

    name: str
    track: PhonemeTrack
    exclude: tuple[int, ...] = ()
    media: Path | None = None


@dataclass(frozen=True)
class Seen:
    """What the detector sees in the pictures of a sentence, frames without a face left out."""

    frames: npt.NDArray[np.int64]
    height: npt.NDArray[np.float64]
    opening: npt.NDArray[np.float64]
    mouths: list[Picture]


@dataclass
class Row:
    """A way of making sentences, and how its lips did."""

    closures: list[tuple[float, int]] = field(default_factory=list)
    silences: list[float] = field(default_factory=list)
    pieces: list[float] = field(default_factory=list)
    rested: list[float] = field(default_factory=list)

    def add(self, seen: Seen, track: PhonemeTrack, closed_at: float, fps: float) -> None:
        """Count a sentence."""
        if len(seen.frames) == 0:
            return
        closed = closed_frames(seen.opening, seen.frames, closed_at, fps)
        rate = closure_hit_rate(closed, seen.frames, track, fps)
        if rate is not None:
            phones = int(np.isin(track.phonemes, list(CLOSURES)).sum())
            self.closures.append((rate, phones))
        motion = silence_motion(seen.height, seen.frames, track, fps)
        if motion is not None:
            self.silences.append(motion.sd)
        times = (seen.frames + 0.5) / fps
        deviations = [
            seen.height[inside] - seen.height[inside].mean()
            for start, end in track.silences(LONG_SILENCE)
            for first in np.arange(start, max(end - PIECE, start) + 1e-9, PIECE)
            if (inside := (times >= first) & (times < min(first + PIECE, end))).sum() > 1
        ]
        if deviations:
            self.pieces.append(float(np.sqrt(np.mean(np.concatenate(deviations) ** 2))))
        for start, end in track.silences(LONG_SILENCE):
            # The middle third, where lips are at rest if they ever are.
            third = (end - start) / 3
            inside = (times >= start + third) & (times < end - third)
            self.rested += (seen.opening[inside] <= closed_at).tolist()

    @property
    def hits(self) -> float:
        """Share of all p, b and m in which the lips close."""
        rates, phones = np.array(self.closures).T
        return float(np.average(rates, weights=phones))

    def sd(self, pieces: bool = False) -> float:
        """Mean over sentences of the standard deviation of lip height in silences, or pieces."""
        return float(np.mean(self.pieces if pieces else self.silences))


class Detector:
    """The raw face mesh on pictures."""

    def __init__(self) -> None:
        self._finder = FaceFinder(find_models())

    def look(self, pictures: Iterable[Picture]) -> Seen:
        """Measure the pictures of a sentence, in their order."""
        self._finder.reset()
        frames, meshes, mouths = [], [], []
        for i, picture in enumerate(pictures):
            found = self._finder.find(picture)
            if found is not None:
                frames.append(i)
                meshes.append(found.points)
                mouths.append(_mouth(picture, found.points))
        points = np.array(meshes, dtype=np.float64).reshape(len(frames), -1, 3)
        return Seen(
            np.array(frames, dtype=np.int64),
            mesh_mouth_height(points[..., :2]),
            lip_opening(points[..., :2]),
            mouths,
        )


def _mouth(picture: Picture, points: npt.NDArray[np.floating]) -> Picture:
    lips = points[[*OUTER_LIPS, *INNER_LIPS], :2]
    x, y = lips.mean(axis=0)
    side = 1.5 * float(np.ptp(lips[:, 0]))
    to_tile = np.array([[TILE / side, 0, TILE / 2 - x * TILE / side]])
    to_tile = np.vstack([to_tile, [[0, TILE / side, TILE / 2 - y * TILE / side]]])
    tile = cv2.warpAffine(picture, to_tile, (TILE, TILE), flags=cv2.INTER_CUBIC)
    return np.asarray(tile, dtype=np.uint8)


def recorded(database: UnitDatabase, count: int) -> list[Sentence]:
    """Sentences of the database whose footage is still there, spread evenly."""
    found = []
    for s, (name, media) in enumerate(
        zip(database.sequences.name, database.sequences.media, strict=True)
    ):
        whole = database.starts[s] == 0 and np.isclose(database.sequences.fps[s], database.fps)
        if whole and Path(media).is_file():
            found.append(Sentence(name, database.sequence_track(s), (s,), Path(media)))
    return _spread(found, count)


def heldout(database: UnitDatabase, folder: Path, count: int) -> list[Sentence]:
    """Clips of a folder that the database does not hold."""
    aligner = Aligner(speaking_lexicon())
    known = set(database.sequences.name)
    found = []
    for clip in _spread([c for c in find_clips(folder) if c.name not in known], count):
        try:
            sound, seconds = read_sound(clip.media), probe(clip.media).duration
            track = align_clip(clip, sound, seconds, aligner).track
            found.append(Sentence(clip.name, track, (), Path(clip.media)))
        except UnitselError as error:
            print(f"left out: {error}")
    return found


def _spread(items: list, count: int) -> list:
    places = np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int)
    return [items[i] for i in places]


def typed() -> list[Sentence]:
    """Typed sentences, spoken by espeak at each of `RATES`."""
    try:
        return [
            Sentence(f"{rate}: {text}", speak(text, rate=rate).track)
            for text in TYPED
            for rate in RATES
        ]
    except SpeechError as error:
        print(f"no typed sentences: {error}")
        return []


def chattering(selection: Selection, sentence: Sentence, database: UnitDatabase) -> Selection:
    """Spoil a selection: every other frame of a silence shows wide open lips."""
    units = selection.units.copy()
    wide = _wide(database)
    times = frame_times(len(units), selection.fps)
    for start, end in sentence.track.silences(LONG_SILENCE):
        inside = np.flatnonzero((times >= start) & (times < end))
        units[inside[::2]] = wide
    return replace(selection, units=units)


def frozen(selection: Selection, sentence: Sentence, database: UnitDatabase) -> Selection:
    """Spoil a selection: a silence shows one frame."""
    units = selection.units.copy()
    times = frame_times(len(units), selection.fps)
    for start, end in sentence.track.silences(LONG_SILENCE):
        inside = (times >= start) & (times < end)
        units[inside] = units[inside][0] if inside.any() else 0
    return replace(selection, units=units)


def gaping(selection: Selection, sentence: Sentence, database: UnitDatabase) -> Selection:
    """Spoil a selection: p, b and m show open lips, and so do the frames beside them."""
    units = selection.units.copy()
    times = frame_times(len(units), selection.fps)
    for i in np.flatnonzero(np.isin(sentence.track.phonemes, list(CLOSURES))):
        start, end = sentence.track.boundaries[i : i + 2]
        units[(times >= start - 0.08) & (times < end + 0.08)] = _wide(database)
    return replace(selection, units=units)


def _wide(database: UnitDatabase) -> int:
    opening = database.units.inner_opening
    return int(np.argmin(np.abs(opening - np.percentile(opening, 90))))


SPOILED = (chattering, frozen, gaping)


class Comparison:
    """Renders sentences in several ways and looks at them."""

    def __init__(self, database: UnitDatabase) -> None:
        self.database = database
        self.detector = Detector()
        self.closed_at = Rulers(database).closed_at
        self.makers = {}
        for target in ("paper", "mixed"):
            settings = settings_for(target)
            if TargetSettings(target).guide in (None, *database.guides):
                plain = replace(settings, lips=OFF)
                self.makers[f"{target}, without"] = Synthesizer(database, plain)
                self.makers[target] = Synthesizer(database, settings)
        self.best = list(self.makers)[-1]
        self.background = next(iter(self.makers.values())).background()
        self.colour = probe(self.background.path).colour

    def real(self, sentence: Sentence) -> Seen:
        """Look at the recording of a sentence."""
        assert sentence.media is not None
        frames = read_video(sentence.media, fps=self.database.fps)
        return self.detector.look(frame.rgb for frame in frames)

    def made(self, sentence: Sentence, spoil: bool = False) -> Iterator[tuple[str, Seen]]:
        """Make a sentence in each way and look at it; with spoilt ones after the last."""
        for name, maker in self.makers.items():
            selection = maker.select(sentence.track, exclude_sequences=sentence.exclude)
            yield name, self._rendered(maker, selection)
        if spoil:
            for how in SPOILED:
                yield how.__name__, self._rendered(maker, how(selection, sentence, self.database))

    def _rendered(self, maker: Synthesizer, selection: Selection) -> Seen:
        pictures = maker.render(selection, background=self.background, fps=self.database.fps)
        return self.detector.look(planes_to_rgb(p, self.colour) for p in pictures)


def table(rows: dict[str, Row], real: Row, pieces: bool = False) -> None:
    """Print how each way did beside the recordings, and whether it is within the bars."""
    print(f"  {'':<18} closed in p b m   silences: sd  over real  closed amid them   bars")
    for name, row in rows.items():
        ratio = row.sd(pieces) / real.sd(pieces)
        held = (
            "" if row.hits >= real.hits - CLOSURE_BAR else "closure",
            "" if SILENCE_BAR[0] <= ratio <= SILENCE_BAR[1] else "silence",
        )
        missed = " and ".join(filter(None, held))
        print(
            f"  {name:<18} {row.hits:15.3f} {row.sd(pieces):14.4f} {ratio:10.2f} "
            f"{np.mean(row.rested):17.3f}   {f'misses {missed}' if missed else 'held'}"
        )


def tiles(seen: Seen, track: PhonemeTrack, fps: float) -> tuple[list[Picture], list[Picture]]:
    """Mouths amid each p, b and m, and amid each long silence."""
    closures: list[Picture] = []
    silences: list[Picture] = []
    amid = [
        (closures, (track.boundaries[i] + track.boundaries[i + 1]) / 2)
        for i in np.flatnonzero(np.isin(track.phonemes, list(CLOSURES)))
    ]
    for start, end in track.silences(LONG_SILENCE):
        amid += [(silences, start + part * (end - start)) for part in (0.25, 0.5, 0.75)]
    for group, time in amid:
        place = int(np.argmin(np.abs((seen.frames + 0.5) / fps - time)))
        group.append(seen.mouths[place])
    return closures, silences


def strip(path: Path, rows: Sequence[list[Picture]]) -> None:
    """Write mouths, a row a way of making them."""
    blank = np.full((TILE, TILE, 3), 255, np.uint8)
    lines = [np.hstack([*r[:COLUMNS], *[blank] * (COLUMNS - len(r))]) for r in rows]
    cv2.imwrite(str(path), cv2.cvtColor(np.vstack(lines), cv2.COLOR_RGB2BGR))


def run(options: argparse.Namespace, database: UnitDatabase) -> None:
    """Compare, print and draw."""
    sentences = (
        heldout(database, options.clips, options.sentences)
        if options.clips
        else recorded(database, options.sentences)
    )
    if not sentences:
        print("rest_closure: no recording of these sentences is where it was; nothing to compare")
        return
    comparison = Comparison(database)
    fps, closed_at = database.fps, comparison.closed_at
    real, rows = Row(), {n: Row() for n in (*comparison.makers, *(how.__name__ for how in SPOILED))}
    real_tiles: tuple[list[Picture], list[Picture]] = ([], [])
    for i, sentence in enumerate(sentences):
        seen = comparison.real(sentence)
        real.add(seen, sentence.track, closed_at, fps)
        shown = {"real": tiles(seen, sentence.track, fps)}
        for group, more in zip(real_tiles, shown["real"], strict=True):
            group += more
        for name, seen in comparison.made(sentence, spoil=True):
            rows[name].add(seen, sentence.track, closed_at, fps)
            shown[name] = tiles(seen, sentence.track, fps)
        _draw(options.strips, sentence.name, [shown["real"], *_two(shown, comparison.best)])
        print(f"  {i + 1} of {len(sentences)}", end="\r", file=sys.stderr)
    print(f"{len(sentences)} recorded sentences, {sum(n for _, n in real.closures)} p, b and m:")
    table({"real": real, **rows}, real)
    spoken = [] if options.recorded_only else typed()
    rates = {r: {n: Row() for n in comparison.makers} for r in RATES}
    for i, sentence in enumerate(spoken):
        rate = int(sentence.name.partition(":")[0])
        shown = {"real": real_tiles}
        for name, seen in comparison.made(sentence):
            rates[rate][name].add(seen, sentence.track, closed_at, fps)
            shown[name] = tiles(seen, sentence.track, fps)
        _draw(options.strips, f"typed{i}", [real_tiles, *_two(shown, comparison.best)])
        print(f"  {i + 1} of {len(spoken)}", end="\r", file=sys.stderr)
    for rate, made in rates.items():
        if spoken:
            print(f"{len(TYPED)} typed sentences at {rate} words a minute, beside the real clips:")
            table(made, real, pieces=True)


def _two(
    shown: dict[str, tuple[list[Picture], list[Picture]]], best: str
) -> list[tuple[list[Picture], list[Picture]]]:
    return [shown[f"{best}, without"], shown[best]]


def _draw(
    folder: Path | None, name: str, rows: Sequence[tuple[list[Picture], list[Picture]]]
) -> None:
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        for k, what in enumerate(("closures", "silences")):
            strip(folder / f"{name}_{what}.png", [row[k] for row in rows])


def main() -> int:
    """Print the tables; without a database or footage say what is missing."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("database", nargs="?", default=os.environ.get("UNITSEL_BENCH_DB"))
    parser.add_argument("--sentences", type=int, default=12)
    parser.add_argument("--clips", type=Path)
    parser.add_argument("--strips", type=Path)
    parser.add_argument("--recorded-only", action="store_true", help="no typed sentences")
    options = parser.parse_args()
    path = Path(options.database or "out/demo.h5")
    if not path.is_file():
        print(f"rest_closure: no database at {path}; make demo writes one, or name one")
        return 0
    with open_database(path) as database:
        run(options, database)
    return 0


if __name__ == "__main__":
    sys.exit(main())
