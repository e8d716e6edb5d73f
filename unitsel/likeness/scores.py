"""Scores of a made sentence against its recording, and their means over sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from database.track import PhonemeTrack
from unitsel.likeness.eye_measures import (
    SilenceMotion,
    closed_frames,
    closure_hit_rate,
    silence_motion,
)
from unitsel.likeness.measures import correlation, sd_ratio

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Trajectories:
    """A mouth over the n compared frames of a sentence.

    Parameters
    ----------
    pca : (n,) float64
        First PCA weight.
    height : (n,) float64
        Mouth height, mm.
    mesh : (n,) float64, or None
        Mouth height of the raw face mesh (`analysis.lips.mesh_mouth_height`).
    opening : (n,) float64, or None
        Opening of the raw mesh's lips (`unitsel.likeness.eye_measures.lip_opening`).
    """

    pca: FloatArray
    height: FloatArray
    mesh: FloatArray | None
    opening: FloatArray | None


@dataclass(frozen=True)
class PathScores:
    """What can be said of a path of units without its recording.

    Parameters
    ----------
    sl_avg, tc_avg, vc_avg : float
        Equations 12 to 15; the target cost is the paper's, whatever was searched.
    join_jump : float or None
        Greatest jump at a join in relation to natural motion
        (`unitsel.likeness.eye_measures.greatest_join_jump`); None where the database never moves.
    """

    sl_avg: float
    tc_avg: float
    vc_avg: float
    join_jump: float | None


@dataclass(frozen=True)
class Scores:
    """Likeness, costs and what the eye punishes; None where a method has nothing to count.

    Parameters
    ----------
    r_pca, r_h : float
        Correlation of the first PCA weight and of the mouth height with the recording's
        (equation 16), over the whole sentence.
    r_pca_speech, r_h_speech : float
        The same from the first to the last phone that is not silence.
    sd_ratio : float
        Standard deviation of the mouth height inside speech in relation to the recording's.
    sd_ratio_pca : float
        The same of the first PCA weight.
    r_h_mesh, r_h_mesh_speech : float or None
        Correlation of the raw face mesh's mouth height: the ruler that analysis does not move.
    sl_avg, tc_avg, vc_avg, join_jump : float or None
        Of a path of units; see `PathScores`.
    closure_hits : float or None
        Share of p, b and m in which the lips close (`eye_measures.closure_hit_rate`).
    silence_sd, silence_step : float or None
        Movement of the mouth height in long silences, mm (`eye_measures.SilenceMotion`).
    silence_ratio : float or None
        `silence_sd` in relation to the recording's. In a mean over sentences it is the ratio of
        the means: one silence without any motion would make a mean of ratios infinite.
    """

    r_pca: float
    r_h: float
    r_pca_speech: float
    r_h_speech: float
    sd_ratio: float
    sd_ratio_pca: float
    r_h_mesh: float | None
    r_h_mesh_speech: float | None
    sl_avg: float | None
    tc_avg: float | None
    vc_avg: float | None
    join_jump: float | None
    closure_hits: float | None
    silence_sd: float | None
    silence_step: float | None
    silence_ratio: float | None


@dataclass(frozen=True)
class Recording:
    """The recorded sentence that others are scored against.

    Parameters
    ----------
    track : PhonemeTrack
    fps : float
        Frames a second.
    frames : (n,) int64
        Numbers of the frames with a face; all trajectories are of these.
    inside : (n,) bool
        Whether each lies inside speech.
    real : Trajectories
    closed_at : float
        Opening up to which lips are closed (`unitsel.likeness.eye_measures.closure_threshold`).
    """

    track: PhonemeTrack
    fps: float
    frames: npt.NDArray[np.int64]
    inside: npt.NDArray[np.bool_]
    real: Trajectories
    closed_at: float

    def score(self, made: Trajectories, path: PathScores | None = None) -> Scores:
        """Score a made sentence; the recording itself may be one."""
        real, inside = self.real, self.inside
        r_h_mesh = r_h_mesh_speech = None
        if made.mesh is not None and real.mesh is not None:
            r_h_mesh = correlation(made.mesh, real.mesh)
            r_h_mesh_speech = correlation(made.mesh, real.mesh, inside)
        motion, real_motion = self._silence(made), self._silence(real)
        return Scores(
            r_pca=correlation(made.pca, real.pca),
            r_h=correlation(made.height, real.height),
            r_pca_speech=correlation(made.pca, real.pca, inside),
            r_h_speech=correlation(made.height, real.height, inside),
            sd_ratio=sd_ratio(made.height, real.height, inside),
            sd_ratio_pca=sd_ratio(made.pca, real.pca, inside),
            r_h_mesh=r_h_mesh,
            r_h_mesh_speech=r_h_mesh_speech,
            sl_avg=None if path is None else path.sl_avg,
            tc_avg=None if path is None else path.tc_avg,
            vc_avg=None if path is None else path.vc_avg,
            join_jump=None if path is None else path.join_jump,
            closure_hits=self._closures(made),
            silence_sd=None if motion is None else motion.sd,
            silence_step=None if motion is None else motion.step,
            silence_ratio=None
            if motion is None or real_motion is None
            else _ratio(motion.sd, real_motion.sd),
        )

    def _closures(self, made: Trajectories) -> float | None:
        if made.opening is None:
            return None
        closed = closed_frames(made.opening, self.frames, self.closed_at, self.fps)
        return closure_hit_rate(closed, self.frames, self.track, self.fps)

    def _silence(self, made: Trajectories) -> SilenceMotion | None:
        return silence_motion(made.height, self.frames, self.track, self.fps)


def mean_scores(scores: Sequence[Scores], real: Sequence[Scores]) -> Scores:
    """Means over sentences, each over those that have the score.

    Parameters
    ----------
    scores : sequence of Scores
        Of one method, one or more sentences.
    real : sequence of Scores
        Of the recordings of the same sentences.
    """
    means: dict[str, Any] = {
        f.name: _mean([getattr(s, f.name) for s in scores]) for f in fields(Scores)
    }
    still = _mean([r.silence_sd for r in real])
    return replace(Scores(**means), silence_ratio=_ratio(means["silence_sd"], still))


def _mean(values: Sequence[float | None]) -> float | None:
    there = [v for v in values if v is not None]
    return float(np.mean(there)) if there else None


def _ratio(made: float | None, real: float | None) -> float | None:
    return None if made is None or real is None or real <= 0 else made / real
