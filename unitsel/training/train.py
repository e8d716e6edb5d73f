"""Training of the weights on recorded sentences (Liu and Ostermann 2009, section 6).

Sets of weights, at first a grid, are tried on sentences that the database does not hold. Those
that no other beats in all of TC_avg, SL_avg and VC_avg make the Pareto front, which NSGA-II
pushes on until it is stable. Of those on the front whose mouths move most like the recorded
ones, the smoothest is taken. TC_avg is that of the target cost that is searched, in its own scale.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from importlib import metadata
from pathlib import Path

import numpy as np

from analysis.clip import sha256_of
from analysis.corpus import Clip, find_clips
from database.errors import CorpusError, UnitselError
from database.fingerprint import identity
from database.reader import UnitDatabase
from database.track import frame_times
from unitsel.likeness.evaluation import Evaluator
from unitsel.likeness.measures import correlation, speech_frames
from unitsel.settings import SelectionSettings, settings_for
from unitsel.training.pareto import evolve, non_dominated
from unitsel.training.rehearsal import Player, Rehearsal, TrainingSentence
from unitsel.training.result import (
    Motion,
    Training,
    TrainingSettings,
    Trial,
    smoothest_of_the_best,
)
from unitsel.training.trials import TrialFile, Trials
from unitsel.training.weight_space import WeightSpace

Progress = Callable[[str, int, int], None]


def train(
    database: UnitDatabase,
    folder: str | Path,
    settings: TrainingSettings | None = None,
    *,
    state: str | Path | None = None,
    resume: bool = False,
    jobs: int = 1,
    models: str | Path | None = None,
    dictionary: str | Path | None = None,
    progress: Progress | None = None,
) -> Training:
    """Train the weights for a database.

    Parameters
    ----------
    database : UnitDatabase
    folder : path
        Clips with their words or timings that the database does not hold.
    settings : TrainingSettings, optional
    state : path, optional
        File to note every set in that was tried, for `resume`. It is left when the training is
        done; remove it when the result is safe.
    resume : bool
        Whether to go on where a run with the same settings stopped. The result is that of a run
        without a stop.
    jobs : int
        Processes. The result does not depend on it.
    models, dictionary : path, optional
        As for a build.
    progress : callable, optional

    Returns
    -------
    Training

    Raises
    ------
    CorpusError
        If no clip of the folder can be used; one that is part of the database cannot.
    SelectionError
        If the state belongs to another run or cannot be written, or a worker was ended.
    DatabaseError
        If the database lacks the guide that the target cost needs.
    """
    settings = settings or TrainingSettings()
    tell: Progress = progress or (lambda stage, done, total: None)
    if settings.target.guide is not None:
        database.guide(settings.target.guide)  # Raises before the work and not after it.
    found = _sentences(database, folder, settings, models, dictionary, tell)
    base = replace(settings_for(settings.target.name), target=settings.target)
    space = WeightSpace(base, database.fps, settings.features)
    run = {
        "database": identity(database),
        "unitsel": metadata.version("unitsel"),
        "target": asdict(settings.target),
        "lips": asdict(base.lips),
        "features": settings.features,
        **asdict(settings.pareto),
        "sentences": found.marks,
    }
    started = time.monotonic()
    file = None if state is None else TrialFile(state, run, resume=resume)
    try:
        trials = Trials(
            Player(database, Rehearsal(database.path.absolute(), found.sentences, base)),
            space.settings,
            jobs=jobs,
            file=file,
            progress=lambda done, total: tell("trying weights", done, total),
        )
        default = space.numbers(base)
        trials.measure([default])
        evolution = evolve(
            trials.objectives,
            space.start(settings.pareto.seed),
            space.box,
            settings.pareto,
            lambda done, total: tell("generations", done, total),
        )
    finally:
        if file is not None:
            file.close()
    every = [Trial(space.settings(n), m) for n, m in trials.asked.items()]
    front = non_dominated(np.array([t.measures.objectives for t in every]))
    best = sorted((every[i] for i in front), key=lambda t: t.measures.objectives)
    chosen, most_alike = smoothest_of_the_best(best)
    return Training(
        chosen=chosen,
        most_alike=most_alike,
        default=Trial(base, trials.asked[default]),
        front=tuple(best),
        trials=tuple(every),
        evolution=evolution,
        settings=settings,
        database=identity(database),
        sentences=tuple((s.clip, s.words) for s in found.sentences),
        skipped=found.skipped,
        example=_example(trials.player, chosen.settings),
        tried=trials.tried,
        seconds=time.monotonic() - started,
    )


@dataclass(frozen=True)
class _Found:
    """Sentences of a folder; `marks` tells them from others."""

    sentences: tuple[TrainingSentence, ...]
    skipped: tuple[tuple[str, str], ...]
    marks: list[str]


def _sentences(
    database: UnitDatabase,
    folder: str | Path,
    settings: TrainingSettings,
    models: str | Path | None,
    dictionary: str | Path | None,
    tell: Progress,
) -> _Found:
    """Analyse the training clips as `unitsel evaluate` does held-out ones."""
    known = set(database.sequences.sha256)
    skipped: dict[str, str] = {}
    usable: list[tuple[Clip, str]] = []
    clips = find_clips(folder)
    for clip in clips:
        checksum = sha256_of(clip.media)
        if checksum in known:
            skipped[clip.name] = (
                f"{clip.media}: is part of the database, so it trains nothing; build without it "
                f"(--exclude {clip.name})"
            )
        else:
            usable.append((clip, checksum))
    places = np.linspace(0, len(usable) - 1, min(len(usable), settings.sentences)).round()
    chosen = [usable[int(i)] for i in places]
    sentences: list[TrainingSentence] = []
    marks: list[str] = []
    if chosen:
        evaluator = Evaluator(database, models=models, dictionary=dictionary)
    for i, (clip, checksum) in enumerate(chosen):
        tell("analysing sentences", i, len(chosen))
        try:
            sentence = _sentence(evaluator, clip, hears=settings.target.guide == "sound")
        except UnitselError as error:
            skipped[clip.name] = str(error)
        except Exception as error:  # As in a build: one bad clip does not end the rest.
            skipped[clip.name] = f"{clip.media}: unexpected {type(error).__name__}: {error}"
        else:
            sentences.append(sentence)
            marks.append(_mark(sentence, checksum))
    if not sentences:
        raise CorpusError(
            f"{folder}: none of the {len(clips)} clips can be trained with; the first: "
            f"{next(iter(skipped.values()))}"
        )
    tell("analysing sentences", len(chosen), len(chosen))
    return _Found(tuple(sentences), tuple(sorted(skipped.items())), marks)


def _sentence(evaluator: Evaluator, clip: Clip, *, hears: bool) -> TrainingSentence:
    target = evaluator.target(clip)
    if hears and target.sound is None:
        raise CorpusError(f"{clip.media}: has no sound for the target cost to hear")
    return TrainingSentence(
        target.clip,
        target.words,
        target.track,
        np.asarray(target.frames, dtype=np.int64),
        target.pca[:, 0].astype(np.float64),
        target.height.astype(np.float64),
        target.sound if hears else None,
    )


def _mark(sentence: TrainingSentence, checksum: str) -> str:
    """What tells a sentence from another, or from itself with other phones.

    Not what was measured in its frames: that may differ in the last digits from one process to
    the next, and who wants to go on must not be refused for it.
    """
    track = sentence.track
    said = repr((checksum, track.phonemes.tolist(), track.boundaries.round(4).tolist()))
    return f"{sentence.clip} {hashlib.sha256(said.encode()).hexdigest()[:16]}"


def _example(player: Player, settings: SelectionSettings) -> Motion:
    """The sentence of median likeness, as the settings play it."""
    fps = player.database.fps
    motions = []
    for i, sentence in enumerate(player.sentences):
        units = player.select(settings, i).units
        frames = np.minimum(sentence.frames, len(units) - 1)
        inside = speech_frames(sentence.track, fps, len(units))[frames]
        pca, height = player.trajectories(units, i)
        motions.append(
            Motion(
                sentence.clip,
                sentence.words,
                frame_times(int(sentence.frames.max()) + 1, fps)[sentence.frames],
                sentence.pca,
                sentence.height,
                pca,
                height,
                correlation(pca, sentence.pca, inside),
                correlation(height, sentence.height, inside),
                sentence.track.speech_span(),
            )
        )
    by_likeness = sorted(motions, key=lambda m: m.r_pca + m.r_h)
    return by_likeness[len(motions) // 2]
