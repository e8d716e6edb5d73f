"""Guides fitted to a corpus: what its mouths do, learnt from phonemes and sound.

Tried on folds of GRID's `build` (correlation inside speech, first PCA weight and mouth height):
ridge from hard phonemes of +-5 frames 0.74 and 0.76; ridge from shares in bins 0.80 and 0.83; one
hidden layer on the inputs of database/guide_model.py 0.86 and 0.88; gradient-boosted trees 0.86
and 0.87 at ten times the time.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed
from scipy.sparse import csr_matrix
from threadpoolctl import threadpool_limits

from database.guide_model import guide_inputs, network_outputs
from database.schema import GuideModel
from database.track import PhonemeTrack

F32 = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]

BATCH: Final = 256

SPARSE: Final = 0.1
"""Share of inputs that are not 0 below which it is quicker to leave those out."""


@dataclass(frozen=True)
class GuideSettings:
    """How guides are fitted.

    Parameters
    ----------
    fewest_clips : int
        Clips below which none is fitted.
    hidden : int
        Units of the hidden layer.
    members : int
        Networks that are averaged.
    decay : float
        L2 penalty of the weights.
    epochs : int
        Passes over the corpus, at least.
    steps : int
        Steps of the optimiser, at least: small corpora are passed over more often.
    held_back : int
        One clip in so many is held back to measure skill and gain.
    seed : int
    """

    fewest_clips: int = 20
    hidden: int = 256
    members: int = 3
    decay: float = 1.0
    epochs: int = 15
    steps: int = 1300
    held_back: int = 5
    seed: int = 0


@dataclass(frozen=True)
class GuideClip:
    """What a clip teaches a guide.

    Parameters
    ----------
    track : PhonemeTrack
    times : (n,) float
        Middles of the frames with a face, seconds.
    parameters : (n, O) float32
        `database.guide_model.mouth_parameters`.
    sound : (steps, 26) float, optional
        `database.sound_features.sound_features`.
    """

    track: PhonemeTrack
    times: npt.NDArray[np.float64]
    parameters: F32
    sound: npt.NDArray[np.floating] | None


def fit_guides(
    clips: Sequence[GuideClip],
    settings: GuideSettings | None = None,
    jobs: int = 1,
    tell: Callable[[str, int, int], None] | None = None,
) -> dict[str, GuideModel]:
    """Fit the guides that the clips have enough for.

    Parameters
    ----------
    clips : sequence of GuideClip
    settings : GuideSettings, optional
    jobs : int
        Networks fitted at a time; the result does not depend on it.
    tell : callable, optional
        Progress: stage, done, total.

    Returns
    -------
    dict of str to GuideModel
        "phonemes", and "sound" from the clips that have it; empty for a small corpus.
    """
    chosen = settings or GuideSettings()
    hearing = [c for c in clips if c.sound is not None and len(c.sound)]
    found = {}
    for kind, mine in (("phonemes", list(clips)), ("sound", hearing)):
        if len(mine) >= chosen.fewest_clips:
            found[kind] = _fit(kind, mine, chosen, jobs, tell or (lambda stage, done, total: None))
    return found


def _fit(
    kind: str,
    clips: Sequence[GuideClip],
    settings: GuideSettings,
    jobs: int,
    tell: Callable[[str, int, int], None],
) -> GuideModel:
    everything = np.concatenate(
        [
            guide_inputs(c.track, c.times, None if kind == "phonemes" else _as_f32(c.sound))
            for c in clips
        ]
    )
    wanted = np.concatenate([c.parameters for c in clips])
    clip = np.repeat(np.arange(len(clips)), [len(c.times) for c in clips])
    # Phonemes that the corpus lacks say nothing.
    columns = np.flatnonzero(np.ptp(everything, axis=0) > 0).astype(np.int32)
    inputs = np.ascontiguousarray(everything[:, columns])
    mean, scale = wanted.mean(axis=0, dtype=np.float64), wanted.std(axis=0, dtype=np.float64)
    scale[scale < 1e-6] = 0.0
    outputs = ((wanted - mean) / np.where(scale > 0, scale, 1)).astype(np.float32)
    back = clip % settings.held_back == settings.held_back - 1
    tasks = [(np.flatnonzero(~back), settings.seed)]
    tasks += [(np.arange(len(clip)), settings.seed + m) for m in range(settings.members)]
    stage = f"learning from {kind}"
    tell(stage, 0, len(tasks))
    networks = []
    run = Parallel(n_jobs=min(jobs, len(tasks)), return_as="generator")
    for network in run(delayed(_network)(inputs[r], outputs[r], settings, s) for r, s in tasks):
        networks.append(network)
        tell(stage, len(networks), len(tasks))

    def model(members: list[tuple[F32, ...]], gain: F32, skill: F32) -> GuideModel:
        hidden, hidden_bias, output, output_bias = (
            np.stack(part) for part in zip(*members, strict=True)
        )
        centre, spread = mean.astype(np.float32), scale.astype(np.float32)
        return GuideModel(
            columns, hidden, hidden_bias, output, output_bias, centre, spread, gain, skill
        )

    ones = np.ones(outputs.shape[1], dtype=np.float32)
    trial = network_outputs(model(networks[:1], ones, ones), inputs[back])
    inside = np.concatenate([_inside(c) for c in clips])[back]
    gain, skill = _gain_and_skill(trial, outputs[back], clip[back], inside)
    return model(networks[1:], gain, skill)


def _network(inputs: F32, outputs: F32, settings: GuideSettings, seed: int) -> tuple[F32, ...]:
    """Fit one network; its four arrays of weights, hidden layer first."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.neural_network import MLPRegressor  # Slow to load, and only builds need it.

    passes = max(settings.epochs, -(-settings.steps // max(1, len(inputs) // BATCH)))
    network: Any = MLPRegressor(
        hidden_layer_sizes=(settings.hidden,),
        alpha=settings.decay,
        batch_size=min(BATCH, len(inputs)),
        max_iter=passes,
        n_iter_no_change=passes,
        random_state=seed,
    )
    # Shares of phonemes are mostly 0; the sound's inputs are not.
    given: Any = csr_matrix(inputs) if np.count_nonzero(inputs) < SPARSE * inputs.size else inputs
    # One thread: sums in another order would give another database.
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        network.fit(given, outputs)
    (hidden, output), (hidden_bias, output_bias) = network.coefs_, network.intercepts_
    parts = (hidden, hidden_bias, output, output_bias)
    return tuple(np.ascontiguousarray(p, dtype=np.float32) for p in parts)


def _gain_and_skill(
    predicted: F32, real: F32, clip: npt.NDArray[np.integer], inside: BoolArray
) -> tuple[F32, F32]:
    """How much more the real mouths move, and how alike the two are, inside speech.

    Means over the clips; predictions of what cannot be known move less than what happens.
    """
    gains, skills = [], []
    for c in np.unique(clip):
        mine = (clip == c) & inside
        if mine.sum() < 5:
            continue
        a, b = predicted[mine].astype(np.float64), real[mine].astype(np.float64)
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        sizes = np.sqrt((a**2).sum(axis=0)), np.sqrt((b**2).sum(axis=0))
        gains.append(sizes)
        skills.append((a * b).sum(axis=0) / np.maximum(sizes[0] * sizes[1], 1e-12))
    if not skills:
        ones = np.ones(predicted.shape[1], dtype=np.float32)
        return ones, np.zeros_like(ones)
    moves, moved = np.sum([g[0] for g in gains], axis=0), np.sum([g[1] for g in gains], axis=0)
    gain = np.where(moves > 1e-9, moved / np.maximum(moves, 1e-9), 1.0)
    return np.clip(gain, 1.0, 1.5).astype(np.float32), np.mean(skills, axis=0).astype(np.float32)


def _inside(clip: GuideClip) -> BoolArray:
    start, end = clip.track.speech_span()
    return (clip.times >= start) & (clip.times < end)


def _as_f32(sound: npt.NDArray[np.floating] | None) -> F32 | None:
    return None if sound is None else np.asarray(sound, dtype=np.float32)
