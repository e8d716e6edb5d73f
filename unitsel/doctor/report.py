"""The doctor's report: facts of all clips, coverage, expected quality, advice, and findings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from database.errors import CorpusError
from database.phonemes import N_VISEMES, VISEMES
from database.reader import open_database
from unitsel.doctor.coverage import Advice, Coverage, what_to_record
from unitsel.doctor.english import count_diphones, english
from unitsel.doctor.facts import (
    AXES,
    ClipFacts,
    Limits,
    alignment_faults,
    clip_faults,
    poses_outside,
    usable,
)
from unitsel.doctor.footage import corpus_facts
from unitsel.doctor.quality import SENTENCES, Quality, expected_quality
from unitsel.doctor.stored import database_facts

ADVICE: Final = 25
"""Sentences that are recommended by default."""

NAMED: Final = 6
"""Visemes that a finding names."""

Tone = Literal["good", "note", "bad"]


@dataclass(frozen=True)
class Finding:
    """A sentence of the summary: how serious, about which part of the page, and what."""

    tone: Tone
    part: str
    text: str


@dataclass(frozen=True)
class DoctorReport:
    """What the doctor found.

    Parameters
    ----------
    source : Path
        The folder or database.
    built : bool
        Whether it is a database.
    clips : tuple of ClipFacts
    coverage : Coverage
    advice : tuple of Advice
    quality : Quality or str
        Why there is none, as text.
    limits : Limits
    """

    source: Path
    built: bool
    clips: tuple[ClipFacts, ...]
    coverage: Coverage
    advice: tuple[Advice, ...]
    quality: Quality | str
    limits: Limits = field(default_factory=Limits)

    @property
    def usable(self) -> list[ClipFacts]:
        """Clips that nothing keeps out of a database."""
        return usable(self.clips)

    @property
    def skipped(self) -> list[ClipFacts]:
        """Clips that cannot be used."""
        return [c for c in self.clips if c.error]

    @cached_property
    def rotations(self) -> npt.NDArray[np.float64]:
        """Degrees of all frames with a face, (n, 3)."""
        return np.concatenate([np.zeros((0, 3)), *(c.rotations for c in self.usable)])

    @cached_property
    def translations(self) -> npt.NDArray[np.float64]:
        """Millimetres of all frames with a face, (n, 3)."""
        return np.concatenate([np.zeros((0, 3)), *(c.translations for c in self.usable)])

    @cached_property
    def outside(self) -> npt.NDArray[np.bool_]:
        """Which of these frames are outside the good range, by parameter, (n, 6)."""
        return poses_outside(self.rotations, self.translations, self.limits)

    @cached_property
    def faults(self) -> dict[str, list[str]]:
        """What is wrong with the picture or sound of usable clips."""
        return clip_faults(self.clips, self.limits)

    @cached_property
    def doubts(self) -> dict[str, list[str]]:
        """Why the phones of usable clips are doubted."""
        found = {c.name: alignment_faults(c, self.limits) for c in self.usable}
        return {name: why for name, why in found.items() if why}

    @property
    def rejected_frames(self) -> int:
        """Frames of usable clips that were looked at and show no face."""
        return sum(len(r.frames) for c in self.usable for r in c.rejected)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """The summary, the worst first."""
        order = {"bad": 0, "note": 1, "good": 2}
        return tuple(sorted(_findings(self), key=lambda f: order[f.tone]))

    def as_json(self) -> dict[str, Any]:
        """The report for machines."""
        shares = self.outside.mean(axis=0) if len(self.outside) else np.zeros(6)
        return {
            "source": str(self.source),
            "kind": "database" if self.built else "corpus",
            "clips": len(self.clips),
            "usable": len(self.usable),
            "seconds": round(sum(c.seconds for c in self.usable), 2),
            "findings": [vars(f) for f in self.findings],
            "coverage": self.coverage.as_json(),
            "pose_outside": {
                name: round(float(s), 4) for (name, _), s in zip(AXES, shares, strict=True)
            },
            "skipped": [{"clip": c.name, "reason": c.error} for c in self.skipped],
            "rejected_frames": self.rejected_frames,
            "faults": self.faults,
            "doubts": self.doubts,
            "lags": {c.name: round(c.lag, 3) for c in self.usable if c.lag},
            "quality": self.quality.as_json()
            if isinstance(self.quality, Quality)
            else {"grade": None, "verdict": self.quality},
            "record_next": [a.as_json() for a in self.advice],
            "per_clip": [c.as_json() for c in self.clips],
        }


def doctor_report(
    source: str | Path,
    *,
    limit: int | None = None,
    sentences: int = SENTENCES,
    advice: int = ADVICE,
    jobs: int = 1,
    models: str | Path | None = None,
    dictionary: str | Path | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> DoctorReport:
    """Examine a folder of clips, or a database, and say what to record next.

    Of a folder only a few frames a clip are looked at, its sound and its words; the clips of a
    database are all known, and some of its sentences are selected without their recordings.

    Parameters
    ----------
    source : path
        A folder as `unitsel.build_database` takes it, or a database.
    limit : int, optional
        Of a folder: take only so many clips, spread evenly over the sorted names.
    sentences : int
        Of a database: sentences to test its quality with; 0 for no test.
    advice : int
        Most sentences to recommend.
    jobs : int
        Processes.
    models, dictionary : path, optional
        As for a build.
    progress : callable, optional
        Called with a stage, how much of it is done, and of how much.

    Returns
    -------
    DoctorReport

    Raises
    ------
    CorpusError
        If there is nothing at `source`, or no media file in it.
    DatabaseError
        If it is a file but no database, or damaged.
    ModelError, PronunciationError
        If the face models or the dictionary cannot be read.
    """
    tell = progress or (lambda stage, done, total: None)
    path = Path(source)
    if jobs < 1:
        raise CorpusError(f"the number of jobs must be at least 1, not {jobs}")
    if not path.exists():
        raise CorpusError(f"{path}: there is no such folder or database; check the name")
    quality: Quality | str
    if path.is_dir():
        clips = corpus_facts(
            path, limit=limit, jobs=jobs, models=models, dictionary=dictionary, tell=tell
        )
        frames = None
        quality = "known only once a database is built: run unitsel doctor on that"
    else:
        with open_database(path) as database:
            clips = database_facts(database, tell)
            frames = np.bincount(database.units.viseme, minlength=N_VISEMES).astype(np.int64)
            quality = "not tested, as was asked"
            if sentences > 0:
                quality = expected_quality(database, sentences, jobs=jobs, tell=tell)
    said = [c.phonemes for c in usable(clips) if c.phonemes is not None]
    coverage = Coverage(count_diphones(said), frames, english())
    return DoctorReport(
        path,
        not path.is_dir(),
        tuple(clips),
        coverage,
        tuple(what_to_record(coverage, advice)),
        quality,
    )


def _findings(report: DoctorReport) -> list[Finding]:
    """What a reader should know first."""
    return [
        *_clip_findings(report),
        *_coverage_findings(report),
        *_pose_findings(report),
        *_picture_findings(report),
        *_sound_findings(report),
        _quality_finding(report),
    ]


def _clip_findings(report: DoctorReport) -> list[Finding]:
    n, skipped = len(report.clips), len(report.skipped)
    if not report.usable:
        return [Finding("bad", "rejected", f"None of the {n} clips can be used.")]
    found = []
    if skipped:
        tone: Tone = "bad" if skipped > 0.1 * n else "note"
        found.append(Finding(tone, "rejected", f"{skipped} of {n} clips cannot be used."))
    if report.rejected_frames:
        clips = sum(bool(c.rejected) for c in report.usable)
        looked = sum(c.looked for c in report.usable)
        share = report.rejected_frames / max(looked, 1)
        what = f"{report.rejected_frames} of {looked} frames looked at"
        found.append(
            Finding(
                "bad" if share > 0.05 else "note",
                "rejected",
                f"{what} ({share:.1%}) show no face, in {clips} of {len(report.usable)} clips.",
            )
        )
    if not found:
        found.append(Finding("good", "rejected", f"All {n} clips can be used, all their frames."))
    return found


def _coverage_findings(report: DoctorReport) -> list[Finding]:
    c = report.coverage
    share = c.share()
    tone: Tone = "good" if share >= 0.95 else "note" if share >= 0.8 else "bad"
    found = [
        Finding(
            tone,
            "coverage",
            f"Of the diphones of English text, by how often they come, {share:.0%} are recorded, "
            f"and {c.viseme_share():.0%} of the steps from viseme to viseme: texts "
            "unlike the recorded ones will often be made of pictures from another context.",
        )
        if tone != "good"
        else Finding(tone, "coverage", f"{share:.0%} of the diphones of English are recorded.")
    ]
    if missing := c.missing_phonemes():
        what = "phoneme is" if len(missing) == 1 else "phonemes are"
        named = ", ".join(missing)
        found.append(Finding("bad", "coverage", f"{len(missing)} {what} never spoken: {named}."))
    scarce = [v for v in c.thin_visemes() if c.visemes[v] > 0]
    if scarce:
        named = "; ".join(" ".join(VISEMES[v]) for v in scarce[:NAMED])
        more = f"; and {len(scarce) - NAMED} more" if len(scarce) > NAMED else ""
        found.append(Finding("note", "coverage", f"Few recordings of the visemes {named}{more}."))
    return found


def _pose_findings(report: DoctorReport) -> list[Finding]:
    if not len(report.outside):
        return []
    share = float(report.outside.any(axis=1).mean())
    text = f"{share:.1%} of the frames have the head outside the good range."
    tone: Tone = "good" if share <= 0.01 else "note" if share <= 0.1 else "bad"
    return [Finding(tone, "pose", text)]


def _picture_findings(report: DoctorReport) -> list[Finding]:
    seen = [c for c in report.usable if c.faces]
    if not seen:
        return []
    found = []
    width = float(np.median([c.mouth_pixels for c in seen]))
    if width < report.limits.mouth_pixels:
        found.append(
            Finding(
                "note",
                "picture",
                f"The mouth is only {width:.0f} pixels wide: film closer or at a higher "
                "resolution for sharper synthesis.",
            )
        )
    if len({c.size for c in seen}) > 1 or len({round(c.fps, 2) for c in seen}) > 1:
        found.append(
            Finding("note", "picture", "The clips are not all of one size and frame rate.")
        )
    if silent := sum(c.sound is None for c in seen) if not report.built else 0:
        found.append(Finding("note", "picture", f"{silent} of {len(seen)} clips have no sound."))
    bad = len(report.faults)
    if bad:
        tone: Tone = "bad" if bad > 0.1 * len(seen) else "note"
        text = f"{bad} of {len(seen)} clips have a fault of blur, light or sound."
        found.append(Finding(tone, "picture", text))
    else:
        found.append(Finding("good", "picture", "Blur, light and sound are even over all clips."))
    return found


def _sound_findings(report: DoctorReport) -> list[Finding]:
    found = []
    n = len(report.usable)
    if doubted := len(report.doubts):
        tone: Tone = "bad" if doubted > 0.1 * n else "note"
        text = f"The phones of {doubted} of {n} clips are doubtful."
        found.append(Finding(tone, "alignment", text))
    elif n:
        found.append(Finding("good", "alignment", "No clip's phones are doubtful."))
    if late := sum(c.lag != 0 for c in report.usable):
        text = f"Sound and lips of {late} of {n} clips are apart."
        found.append(Finding("note", "lags", text))
    return found


def _quality_finding(report: DoctorReport) -> Finding:
    if isinstance(report.quality, str):
        return Finding("note", "quality", f"Expected quality of synthesis: {report.quality}.")
    tones: dict[str, Tone] = {"good": "good", "fair": "note", "poor": "bad"}
    return Finding(tones[report.quality.grade], "quality", report.quality.verdict)
