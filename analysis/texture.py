"""Texture of the mouth: lighting taken out, then principal components.

Lighting differs between clips (another day, another exposure) and would be the first principal
component if it were left in. The rule, stored in every database and used on every clip that is
compared with it: a clip's mean log picture is compared with the reference on the skin around
the mouth, the difference is fitted a channel by a constant and a slope across and down, and
that gain is divided out. Pictures themselves are stored as recorded.

The normalised crop is weighted by a window around the mouth, so that the components describe
lips, teeth and chin rather than the edge of the cheek.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.schema import TextureModel

FloatArray = npt.NDArray[np.float32]

REDUCED_WIDTH, REDUCED_HEIGHT = 40, 42
"""Size to which crops are reduced before they are described: texture, not detail."""

LOG_OFFSET: Final = 8.0
"""Levels added before the logarithm, so that noise in the dark does not count."""


@dataclass(frozen=True)
class TextureSettings:
    """What the principal components are fitted on.

    Parameters
    ----------
    components : int
        PCA weights kept (the paper's distances use 12).
    sample : int
        Frames that the components are fitted on, drawn at random.
    seed : int
        Of that draw.
    """

    components: int = 16
    sample: int = 4000
    seed: int = 0


def reduce_crop(crop: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """A crop at the size in which it is described, (42, 40, 3) uint8."""
    size = (REDUCED_WIDTH, REDUCED_HEIGHT)
    return np.asarray(cv2.resize(crop, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def mean_log(reduced: npt.NDArray[np.uint8]) -> FloatArray:
    """Mean log picture of a clip, (42, 40, 3): what its lighting is judged by."""
    return np.asarray(np.log(reduced.astype(np.float32) + LOG_OFFSET).mean(axis=0))


def lighting_of(clip_mean: FloatArray, reference: FloatArray) -> FloatArray:
    """Lighting of a clip against the reference.

    Parameters
    ----------
    clip_mean, reference : (42, 40, 3) float32
        Mean log pictures.

    Returns
    -------
    (3, 3) float32
        Log gain: for each channel a constant and slopes across and down (over half the crop).
    """
    skin = _skin()
    base = _slopes()[skin]
    fit, *_ = np.linalg.lstsq(base, (clip_mean - reference)[skin], rcond=None)
    return np.asarray(fit.T, dtype=np.float32)


def normalise(reduced: npt.NDArray[np.uint8], lighting: FloatArray) -> FloatArray:
    """Crops of one clip with its lighting taken out, (n, 42, 40, 3) levels."""
    gain = np.exp(_slopes() @ lighting.T).astype(np.float32)
    return np.asarray((reduced.astype(np.float32) + LOG_OFFSET) / gain - LOG_OFFSET)


def fit_texture(
    normalised: FloatArray,
    heights: FloatArray,
    reference: FloatArray,
    settings: TextureSettings | None = None,
) -> TextureModel:
    """Principal components of normalised crops.

    Parameters
    ----------
    normalised : (n, 42, 40, 3) float32
        A sample of frames.
    heights : (n,) float32
        Their mouth heights: components are turned so that they grow with them.
    reference : (42, 40, 3) float32
        Mean log picture that the lighting was compared with.
    settings : TextureSettings, optional

    Returns
    -------
    TextureModel
    """
    from sklearn.decomposition import PCA  # Slow to load, and only builds need it.

    chosen = settings or TextureSettings()
    window = mouth_window()
    values = _windowed(normalised, window)
    count = min(chosen.components, len(values) - 1, values.shape[1])
    pca = PCA(count, svd_solver="randomized", random_state=chosen.seed)
    weights = pca.fit_transform(values)
    grows = weights.T @ (heights - heights.mean())
    signs = np.where(grows < 0, -1.0, 1.0)[:, None]
    return TextureModel(
        mean=pca.mean_.astype(np.float32),
        components=(pca.components_ * signs).astype(np.float32),
        eigenvalues=pca.explained_variance_.astype(np.float32),
        window=window,
        reference=reference.astype(np.float32),
    )


def texture_weights(normalised: FloatArray, model: TextureModel) -> FloatArray:
    """PCA weights of normalised crops, (n, K) float32."""
    values = _windowed(normalised, model.window) - model.mean
    return np.asarray(values @ model.components.T, dtype=np.float32)


def describe_clip(reduced: npt.NDArray[np.uint8], model: TextureModel) -> FloatArray:
    """PCA weights of a clip that is not in the database, by the database's own rule, (n, K)."""
    lighting = lighting_of(mean_log(reduced), model.reference)
    return texture_weights(normalise(reduced, lighting), model)


def mouth_window() -> FloatArray:
    """Weight of each pixel: one on the mouth and the chin below it, none at the crop's edge."""
    u, v = _coordinates()
    return np.asarray(np.exp(-0.5 * ((u / 0.45) ** 2 + (v / 0.5) ** 2) ** 2), dtype=np.float32)


def _windowed(normalised: FloatArray, window: FloatArray) -> FloatArray:
    root = np.sqrt(window)[..., None]
    return np.asarray((normalised * root).reshape(len(normalised), -1), dtype=np.float32)


def _coordinates() -> tuple[FloatArray, FloatArray]:
    """Places in the reduced crop, -1..1 across and down."""
    y, x = np.mgrid[0:REDUCED_HEIGHT, 0:REDUCED_WIDTH].astype(np.float32)
    return (
        (x - (REDUCED_WIDTH - 1) / 2) / (REDUCED_WIDTH / 2),
        (y - (REDUCED_HEIGHT - 1) / 2) / (REDUCED_HEIGHT / 2),
    )


def _slopes() -> FloatArray:
    u, v = _coordinates()
    return np.stack([np.ones_like(u), u, v], axis=-1)


def _skin() -> npt.NDArray[np.bool_]:
    """Skin that every clip shows: around the lips, under the nose, above the chin's edge."""
    u, v = _coordinates()
    lips = (u / 0.62) ** 2 + ((v + 0.05) / 0.40) ** 2 < 1
    nose = (v < -0.55) & (np.abs(u) < 0.45)
    within = (np.abs(u) < 0.9) & (v < 0.6) & (v > -0.7)
    return np.asarray(within & ~lips & ~nose)
