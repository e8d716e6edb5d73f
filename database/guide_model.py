"""A guide: what the mouth is expected to do, predicted from phonemes and, if wanted, sound.

The sample-based system that won the LIPS 2008 and 2009 challenges predicted a trajectory first
and let it guide the choice of samples. Here the prediction is a small ensemble of networks with
one hidden layer, fitted by analysis/guide.py and stored as plain arrays. What goes in, and how a
prediction is computed, must be the same at the build and at the selection, so it stands here.

Inputs of a frame, in this order:

* phonemes around it: the share of each phoneme in 17 bins of 40 ms (`BINS` each side);
* the phone that it lies in and three on each side: which they are, how long they last, where
  they begin; and the frame's place in its own phone;
* with sound: the mel spectrum in 13 bins of 40 ms (database/sound_features.py).

Outputs: the PCA weights, mouth width, height and inner opening, teeth and tongue.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt
from threadpoolctl import ThreadpoolController

from database.phonemes import N_PHONEMES, SILENCE
from database.schema import GuideModel
from database.sound_features import BANDS, around
from database.track import PhonemeTrack

F32 = npt.NDArray[np.float32]
FloatArray = npt.NDArray[np.float64]

BIN_SECONDS: Final = 0.04
BINS: Final = 8
NEIGHBOURS: Final = 3
"""Phones on each side that are told in full."""

SOUND_BINS: Final = 6
SOUND_SCALE: Final = 1 / 3
"""Sound goes in smaller than phonemes: it has many more inputs that move together."""

LONGEST: Final = 0.5
"""Seconds from which on a phone is just long."""

PLACES: Final = 5 + 2 * (2 * NEIGHBOURS + 1)
N_PHONE_INPUTS: Final = (2 * BINS + 1 + 2 * NEIGHBOURS + 1) * N_PHONEMES + PLACES
N_SOUND_INPUTS: Final = (2 * SOUND_BINS + 1) * BANDS


class Mouths(Protocol):
    """Mouth parameters of n frames, as `database.schema.Units` has them."""

    @property
    def pca(self) -> F32:
        """(n, K)."""

    @property
    def mouth_width(self) -> F32:
        """(n,), mm."""

    @property
    def mouth_height(self) -> F32:
        """(n,), mm."""

    @property
    def inner_opening(self) -> F32:
        """(n,), mm."""

    @property
    def teeth(self) -> F32:
        """(n,), 0..1."""

    @property
    def tongue(self) -> F32:
        """(n,), 0..1."""


@dataclass(frozen=True)
class PredictedMouths:
    """Predicted parameters of n frames; see `database.schema.Units` for shapes and units."""

    pca: F32
    mouth_width: F32
    mouth_height: F32
    inner_opening: F32
    teeth: F32
    tongue: F32


def mouth_parameters(mouths: Mouths) -> F32:
    """All parameters side by side, (n, K + 5) float32, in the order of a guide's outputs."""
    geometry = (mouths.mouth_width, mouths.mouth_height, mouths.inner_opening)
    return np.column_stack([mouths.pca, *geometry, mouths.teeth, mouths.tongue]).astype(np.float32)


def guide_inputs(
    track: PhonemeTrack, times: npt.NDArray[np.floating], sound: F32 | None = None
) -> F32:
    """Inputs of some frames.

    Parameters
    ----------
    track : PhonemeTrack
    times : (n,) float
        Middles of the frames, seconds.
    sound : (steps, 26) float, optional
        `database.sound_features.sound_features`, for a guide that hears.

    Returns
    -------
    (n, N_PHONE_INPUTS [+ N_SOUND_INPUTS]) float32
    """
    at: FloatArray = np.asarray(times, dtype=np.float64)
    parts = [_shares(track, at), *_phones_around(track, at)]
    if sound is not None:
        parts.append(around(sound, at, SOUND_BINS, BIN_SECONDS) * np.float32(SOUND_SCALE))
    return np.concatenate(parts, axis=1)


def predict(guide: GuideModel, inputs: F32) -> PredictedMouths:
    """Predict mouths.

    Parameters
    ----------
    guide : GuideModel
    inputs : (n, all inputs) float32
        Of `guide_inputs`; those that the guide does not use are left out here.

    Returns
    -------
    PredictedMouths
        With the motion that a prediction lacks restored (`GuideModel.gain`).
    """
    scaled = network_outputs(guide, inputs[:, guide.columns]) * guide.gain
    out = scaled * guide.scale + guide.mean
    share = np.clip(out[:, -2:], 0, 1)
    k = out.shape[1] - 5
    width, height, opening = np.maximum(out[:, k : k + 3], 0).T
    return PredictedMouths(out[:, :k], width, height, opening, share[:, 0], share[:, 1])


def network_outputs(guide: GuideModel, used: F32) -> F32:
    """Mean output of the networks for (n, I) inputs, before scale and gain, (n, O) float32."""
    total = np.zeros((len(used), len(guide.scale)), dtype=np.float32)
    # One thread: sums in another order would tip near ties of the selection the other way.
    with _controller().limit(limits=1):
        for w, b, v, c in zip(
            guide.hidden, guide.hidden_bias, guide.output, guide.output_bias, strict=True
        ):
            total += np.maximum(used @ w + b, 0) @ v + c
    return total / np.float32(len(guide.hidden))


@cache
def _controller() -> ThreadpoolController:
    """The threads of NumPy's linear algebra; finding them takes a millisecond."""
    return ThreadpoolController()


def _padded(track: PhonemeTrack, times: FloatArray) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Phones with silence before and after that covers all that may be asked for."""
    far = 1.0 + BINS * BIN_SECONDS
    first = min(track.start, float(times.min(initial=0.0))) - far
    last = max(track.end, float(times.max(initial=0.0))) + far
    phonemes = np.concatenate([[SILENCE], track.phonemes, [SILENCE]])
    return phonemes, np.concatenate([[first], track.boundaries, [last]])


def _shares(track: PhonemeTrack, times: FloatArray) -> F32:
    """Share of each phoneme in each bin, (n, (2 BINS + 1) * 43)."""
    phonemes, bounds = _padded(track, times)
    lasting = np.zeros((len(bounds), N_PHONEMES))
    lasting[np.arange(1, len(bounds)), phonemes] = np.diff(bounds)
    before = np.cumsum(lasting, axis=0)
    edges = times[:, None] + (np.arange(-BINS, BINS + 2) - 0.5) * BIN_SECONDS
    place = np.searchsorted(bounds, edges, side="right") - 1
    heard = before[place]
    np.put_along_axis(
        heard,
        phonemes[place][..., None],
        np.take_along_axis(heard, phonemes[place][..., None], 2)
        + (edges - bounds[place])[..., None],
        axis=2,
    )
    shares = np.diff(heard, axis=1) / BIN_SECONDS
    return shares.reshape(len(times), -1).astype(np.float32)


def _phones_around(track: PhonemeTrack, times: FloatArray) -> tuple[F32, ...]:
    """Which phones are around, and how they lie: (n, 7 * 43) and (n, PLACES)."""
    phonemes, bounds = _padded(track, times)
    # The made-up silences are long, however far they reach.
    bounds = bounds.copy()
    bounds[0], bounds[-1] = min(bounds[0], bounds[1] - 1), max(bounds[-1], bounds[-2] + 1)
    own = np.searchsorted(bounds, times, side="right") - 1
    since, left = times - bounds[own], bounds[own + 1] - times
    lasting = since + left
    places = [
        since / lasting,
        (since / lasting) ** 2,
        np.log(lasting),
        np.minimum(since, 0.3),
        np.minimum(left, 0.3),
    ]
    names = []
    for j in range(-NEIGHBOURS, NEIGHBOURS + 1):
        there = (own + j >= 0) & (own + j < len(phonemes))
        k = np.clip(own + j, 0, len(phonemes) - 1)
        name = np.zeros((len(times), N_PHONEMES), dtype=np.float32)
        name[np.arange(len(times)), np.where(there, phonemes[k], SILENCE)] = 1
        names.append(name)
        length = np.where(there, bounds[k + 1] - bounds[k], LONGEST)
        begins = np.where(there, bounds[k] - times, 0.6 * np.sign(j))
        places.append(np.minimum(length, LONGEST) * 5)
        places.append(np.clip(begins, -0.6, 0.6) * 5)
    return np.concatenate(names, axis=1), np.stack(places, axis=1).astype(np.float32)
