"""A small made-up database: no footage is needed for what only needs a database.

Speech here is a chain of phones between two silences; the mouth glides between one shape a
phoneme with a smooth wander on top; its pictures are drawn, its mesh projected. So units of the
same phoneme look alike, neighbours look more alike, and all fields agree with one another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d

from database.cost_definition import feature_groups
from database.lip_model import LEVELS, LipLevel, LipModel
from database.mask import INNER_LIPS, OUTER_LIPS, Camera, Mask, MouthPatch, Poses, project
from database.phonemes import CLOSURES, PHONEME_INDEX, SILENCE, VISEME_OF
from database.pictures import encode
from database.schema import (
    GUIDES,
    RIGID_COARSE,
    RIGID_REGIONS,
    CostModel,
    DatabaseContent,
    GuideModel,
    PhoneMarks,
    Phones,
    RigidTexture,
    Sequences,
    TextureModel,
    UnitLips,
    Units,
)
from database.stored_backgrounds import StoredBackgrounds
from database.track import PhonemeTrack
from database.writer import store_backgrounds, store_selection, write_database

LACKING = ("er", "ng", "oy", "sh", "uh", "zh")
"""Phonemes that GRID's 51 words lack; by default they do not occur here either."""

MISSING = (*range(20, 25), 40)
"""Frames without a face in the sequence that has some."""

CROP_MM = 100.0
NOSE_BASE, CHIN = 2, 152
REST_MM = 50.0
MOUTH = np.array([0.0, 45.0])


def make_content(
    seed: int = 0,
    sequences: int = 6,
    frames: int = 75,
    fps: float = 25.0,
    crop: tuple[int, int] = (40, 42),
    *,
    weights: int = 12,
    missing_in: int | None = 1,
    phonemes: Sequence[str] | None = None,
    names: Sequence[str] | None = None,
    guided: bool = False,
) -> tuple[DatabaseContent, list[np.ndarray], np.ndarray]:
    """Make up a database.

    Parameters
    ----------
    seed : int
        The same seed gives the same database.
    sequences, frames : int
        Number of clips, and frames of each; two units in all at least.
    fps : float
        Frame rate of the clips and the database.
    crop : (int, int)
        Width and height of a crop in pixels.
    weights : int
        PCA weights.
    missing_in : int or None
        Sequence whose frames `MISSING` show no face; those beyond its end do not count.
    phonemes : sequence of str, optional
        Phonemes to speak; all but `LACKING` by default.
    guided : bool
        With random sound, marks and guides, and a stored document of settings.
    names : sequence of str, optional
        Clip names; ``clip00`` and so on by default.

    Returns
    -------
    content : DatabaseContent
    pictures : list of (height, width, 3) uint8
        The units' crops.
    landmarks : (N, 468, 2) float32
    """
    rng = np.random.default_rng(seed)
    spoken = [p for p in PHONEME_INDEX if p not in LACKING] if phonemes is None else phonemes
    alphabet = np.array([PHONEME_INDEX[p] for p in spoken if p != "sil"])
    names = [f"clip{s:02d}" for s in range(sequences)] if names is None else names
    tracks = [_speak(rng, alphabet, frames / fps, names[s]) for s in range(sequences)]
    shapes = _mouth_shapes(rng, weights)
    camera = Camera.assumed(360, 288)
    mask = _mask(rng, crop)

    columns: dict[str, list[np.ndarray]] = {}
    pictures: list[np.ndarray] = []
    meshes: list[np.ndarray] = []
    counts = []
    for s, track in enumerate(tracks):
        phoneme = track.sample(fps, frames)
        # Coarticulation: each shape leans towards its neighbours over some 40 ms.
        body = gaussian_filter1d(shapes[phoneme], 0.04 * fps, axis=0)
        wander = gaussian_filter1d(rng.normal(size=body.shape), 0.2 * fps, axis=0)
        body = body + 0.15 * np.sqrt(fps) * 0.2 * wander * shapes.std(axis=0)
        height, inner, width, teeth, tongue = _mouth(body[:, weights:])
        poses = Poses(
            _walk(rng, frames, fps, 0.03),
            np.array([0, 0, 900]) + _walk(rng, frames, fps, 4.0),
        )
        seen = np.ones(frames, dtype=bool)
        if s == missing_in:
            seen[[f for f in MISSING if f < frames]] = False
        row = {
            "sequence": np.full(frames, s, dtype=np.int32),
            "frame": np.arange(frames, dtype=np.int32),
            "phoneme": phoneme,
            "viseme": VISEME_OF[phoneme],
            "pca": body[:, :weights],
            "mouth_width": width,
            "mouth_height": height,
            "inner_opening": inner,
            "teeth": teeth,
            "tongue": tongue,
            "rotation": poses.rotations,
            "translation": poses.translations,
        }
        for name, values in row.items():
            columns.setdefault(name, []).append(values[seen])
        for i in np.flatnonzero(seen):
            look = (width[i], height[i], inner[i], teeth[i], tongue[i])
            pictures.append(_draw(crop, look, 1 + 0.04 * np.sin(s)))
            meshes.append(_mesh(mask, look, poses.matrix(int(i)), camera))
        counts.append(int(seen.sum()))

    flat = {name: np.concatenate(parts) for name, parts in columns.items()}
    units = Units(
        **{n: v.astype(np.float32) if v.dtype == np.float64 else v for n, v in flat.items()}
    )
    content = DatabaseContent(
        fps=fps,
        units=units,
        sequences=Sequences(
            name=tuple(names),
            words=tuple(" ".join(t.labels[1:-1]) for t in tracks),
            media=tuple(f"{name}.mpg" for name in names),
            sha256=tuple(f"{seed * 1000 + s:064x}" for s in range(sequences)),
            fps=np.full(sequences, fps, dtype=np.float32),
            frames=np.full(sequences, frames, dtype=np.int32),
            first_unit=(np.cumsum(counts) - counts).astype(np.int32),
            units=np.array(counts, dtype=np.int32),
            lighting=rng.normal(0, 0.05, (sequences, 3, 6)).astype(np.float32),
        ),
        phones=Phones(
            sequence=np.repeat(np.arange(sequences), [len(t.phonemes) for t in tracks]).astype(
                np.int32
            ),
            phoneme=np.concatenate([t.phonemes for t in tracks]).astype(np.uint8),
            start=np.concatenate([t.boundaries[:-1] for t in tracks]),
            end=np.concatenate([t.boundaries[1:] for t in tracks]),
        ),
        mask=mask,
        camera=camera,
        texture=_texture(rng, crop, units.pca),
        costs=_costs(rng, shapes[:, :weights], units),
        settings={"made_up": True, "seed": seed},
        report={"skipped": [], "repaired": []},
    )
    if guided:
        sound = tuple(rng.normal(size=(300, 26)).astype(np.float16) for _ in range(sequences))
        guides = {kind: _guide(rng, weights + 5) for kind in GUIDES}
        starts = 2.5 * np.arange(len(content.sequences))
        content = replace(content, sound=sound, guides=guides, starts=starts)
        content = replace(content, marks=_marks(content.phones), rigid=_rigid(rng))
        content = replace(content, lips=_lips(rng, len(units)), consent="Made up; nobody to ask.")
    return content, pictures, np.array(meshes, dtype=np.float32)


def make_database(path: str | Path, *, codec: str = "png", **settings: Any) -> Path:
    """Write the database of `make_content` with the same settings to a file."""
    content, pictures, landmarks = make_content(**settings)
    write_database(path, content, (encode(p, codec) for p in pictures), landmarks, codec)
    if content.guides:
        store_selection(path, {"made_up": True})
        store_backgrounds(path, make_backgrounds())
    return Path(path)


def make_backgrounds(names: Sequence[str] = ("sitting", "portrait")) -> StoredBackgrounds:
    """Make up backgrounds: videos of 30 frames, and a photo as the last one."""
    n = len(names)
    frames = np.array([30] * (n - 1) + [1], np.int32)
    still = np.arange(n) == n - 1
    t = np.arange(frames.sum(), dtype=np.float32)
    return StoredBackgrounds(
        tuple(names),
        tuple(f"{name}.{'png' if s else 'mp4'}" for name, s in zip(names, still, strict=True)),
        tuple(f"{7000 + i:064x}" for i in range(n)),
        still.astype(np.uint8),
        np.full(n, 25.0),
        np.zeros(n, np.int32),
        frames,
        np.stack([0.01 * np.sin(t / 9), 0 * t, 0 * t], axis=1),
        np.stack([np.cos(t / 9), 0 * t, 0 * t + 900], axis=1),
        1 + 0 * t,
        70 + 0.1 * np.sin(t),
        5 + 0.001 * t,
    )


def _marks(phones: Phones) -> PhoneMarks:
    """Mark the inner half of every closure and silence."""
    marked = np.flatnonzero(np.isin(phones.phoneme, [SILENCE, *CLOSURES]))
    start, length = phones.start[marked], (phones.end - phones.start)[marked]
    return PhoneMarks(
        marked.astype(np.int32),
        start + length / 4,
        start + 3 * length / 4,
        np.ones(len(marked), np.uint8),
        (marked % 2).astype(np.uint8),
    )


def _rigid(rng: np.random.Generator, points: int = 12, views: int = 2) -> RigidTexture:
    """A random surface; a real one takes footage (tests/test_gradient_motion.py)."""

    def some(*shape: int) -> np.ndarray:
        return np.abs(rng.normal(size=shape)).astype(np.float32)

    coarse = -(-points // RIGID_COARSE)
    looks = [some(views, n, *more) for n in (points, coarse) for more in ((), (), (3,), ())]
    region = np.arange(points, dtype=np.uint8) % RIGID_REGIONS
    return RigidTexture(
        some(points, 3), region, some(points, 4), some(views, 3).astype(np.float64), *looks
    )


def _guide(rng: np.random.Generator, outputs: int) -> GuideModel:
    """Random networks; a fitted guide takes a corpus (tests/test_guide.py)."""

    def some(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    return GuideModel(
        columns=np.arange(3, 9, dtype=np.int32),
        hidden=some(2, 6, 4),
        hidden_bias=some(2, 4),
        output=some(2, 4, outputs),
        output_bias=some(2, outputs),
        mean=some(outputs),
        scale=np.abs(some(outputs)),
        gain=np.ones(outputs, dtype=np.float32),
        skill=np.zeros(outputs, dtype=np.float32),
    )


def _lips(rng: np.random.Generator, n: int) -> UnitLips:
    """A random lip model; a trained one takes pictures (tests/test_lip_model.py)."""

    def some(*shape: int) -> np.ndarray:
        return np.abs(rng.normal(size=shape)).astype(np.float32) + 0.1

    levels = [
        LipLevel(
            np.array([2, 3], np.int32),
            np.ones((4, 5), np.uint8),
            some(2, 4, 5),
            some(3, 2, 4, 5),
            some(3),
            some(2, 4, 5),
        )
        for _ in range(LEVELS)
    ]
    model = LipModel(
        scale=0.5,
        blur=0.3,
        energy=400.0,
        mean_shape=some(20, 2),
        shape_modes=some(2, 40),
        shape_variances=some(2),
        template=some(20, 2),
        start_bias=some(20, 2),
        start_covariance=some(40, 40),
        levels=tuple(levels),
    )
    return UnitLips(model, some(n, 20, 2), np.ones(n, np.uint8))


def _speak(
    rng: np.random.Generator, alphabet: np.ndarray, seconds: float, name: str
) -> PhonemeTrack:
    """Silence, phones of 50 to 180 ms with a pause now and then, silence."""
    lead, tail = rng.uniform(0.12, 0.2, 2) * seconds
    phonemes, bounds = [SILENCE], [0.0, lead]
    while seconds - tail - bounds[-1] > 0.18:
        pause = phonemes[-1] != SILENCE and rng.random() < 0.04
        choices = alphabet[alphabet != phonemes[-1]] if len(alphabet) > 1 else alphabet
        phonemes.append(SILENCE if pause else int(rng.choice(choices)))
        bounds.append(bounds[-1] + float(np.clip(rng.lognormal(np.log(0.085), 0.35), 0.05, 0.18)))
    if phonemes[-1] == SILENCE:
        bounds[-1] = seconds
    else:
        phonemes.append(SILENCE)
        bounds.append(seconds)
    return PhonemeTrack(np.array(phonemes), np.array(bounds).round(4), name)


def _mouth_shapes(rng: np.random.Generator, weights: int) -> np.ndarray:
    """One mouth a phoneme: PCA weights, then opening, spread, teeth and tongue as z-scores.

    Phonemes of one viseme are near one another. The first weight follows the opening.
    """
    spread = 30 * 0.75 ** np.arange(weights)
    z = rng.normal(size=(int(VISEME_OF.max()) + 1, weights + 4))[VISEME_OF]
    z += 0.25 * rng.normal(size=z.shape)
    closed = [SILENCE, *CLOSURES]
    z[:, weights] = np.abs(z[:, weights])
    z[closed, weights:] = [-1.0, 0.0, -2.0, -2.0]
    z[:, 0] = 0.9 * z[:, weights] + 0.3 * z[:, 0]
    z[:, :weights] *= spread
    return z


def _mouth(z: np.ndarray) -> tuple[np.ndarray, ...]:
    """Z-scores (n, 4) to outer height, inner opening and width in mm, teeth and tongue 0..1."""
    inner = np.clip(5.0 + 4.5 * z[:, 0], 0.0, 25.0)
    width = np.clip(REST_MM + 3.0 * z[:, 1], 35.0, 65.0)
    teeth = np.clip(0.4 + 0.3 * z[:, 2], 0, 1) * np.clip(inner / 4, 0, 1)
    tongue = np.clip(0.3 + 0.25 * z[:, 3], 0, 1) * np.clip(inner / 8, 0, 1)
    return inner + 16.0, inner, width, teeth, tongue


def _walk(rng: np.random.Generator, frames: int, fps: float, size: float) -> np.ndarray:
    """Walk at random, smoothly, in three dimensions that moves by about `size` in a second."""
    steps = gaussian_filter1d(rng.normal(size=(frames, 3)), 0.2 * fps, axis=0, mode="nearest")
    return np.cumsum(steps, axis=0) * size / np.sqrt(fps)


def _ellipse(points: int, width: float, height: float) -> np.ndarray:
    """Points of an ellipse, clockwise in the picture from its left end, (points, 2)."""
    angle = np.pi + np.arange(points) * 2 * np.pi / points
    return np.stack([np.cos(angle) * width / 2, np.sin(angle) * height / 2], axis=1)


def _mask(rng: np.random.Generator, crop: tuple[int, int]) -> Mask:
    """Make a face like half an egg, 140 mm wide and 190 high, mouth 45 mm below its middle."""

    def depth(xy: np.ndarray) -> np.ndarray:
        return -60 * np.sqrt(np.clip(1 - (xy[..., 0] / 85) ** 2 - (xy[..., 1] / 115) ** 2, 0, 1))

    n = 468
    # Sunflower: evenly over the face without a grid's regularity.
    radius, angle = np.sqrt((np.arange(n) + 0.5) / n), np.arange(n) * np.pi * (3 - np.sqrt(5))
    xy = np.stack([70 * radius * np.cos(angle), 95 * radius * np.sin(angle)], axis=1)
    xy += rng.normal(0, 0.3, xy.shape)
    xy[list(OUTER_LIPS)] = _ellipse(20, REST_MM, 16.0) + MOUTH
    xy[list(INNER_LIPS)] = _ellipse(20, 0.8 * REST_MM, 0.0) + MOUTH
    xy[NOSE_BASE], xy[CHIN] = MOUTH - (0, 22), MOUTH + (0, 45)
    vertices = np.concatenate([xy, depth(xy)[:, None]], axis=1).astype(np.float32)
    tall = CROP_MM * crop[1] / crop[0]
    x, y = np.meshgrid(
        np.linspace(-CROP_MM / 2, CROP_MM / 2, 17), np.linspace(-tall / 2, tall / 2, 17)
    )
    flat = np.stack([x, y], axis=-1) + MOUTH
    grid = np.concatenate([flat, depth(flat)[..., None]], axis=-1).astype(np.float32)
    return Mask(vertices, MouthPatch(grid, *crop))


def _mesh(mask: Mask, look: tuple[float, ...], pose: np.ndarray, camera: Camera) -> np.ndarray:
    """Project the mask's vertices, the lips as they stand, (468, 2)."""
    width, height, inner = look[:3]
    vertices = mask.vertices.copy()
    vertices[list(OUTER_LIPS), :2] = _ellipse(20, width, height) + MOUTH
    vertices[list(INNER_LIPS), :2] = _ellipse(20, 0.8 * width, inner) + MOUTH
    return project(vertices, pose, camera)


def _draw(crop: tuple[int, int], look: tuple[float, ...], gain: float) -> np.ndarray:
    """Skin, lips, the dark of the mouth, teeth and tongue, RGB."""
    w, h = crop
    width, height, inner, teeth, tongue = look
    scale = w / CROP_MM
    centre = ((w - 1) / 2, (h - 1) / 2)
    y, x = np.mgrid[0:h, 0:w]
    shade = 1 - 0.25 * ((x - centre[0]) / w) ** 2 - 0.35 * (y / h)
    picture = (np.array([205, 160, 140]) * shade[..., None]).astype(np.uint8)

    def ellipse(across: float, down: float, dy: float, colour: Sequence[float]) -> None:
        if across > 0 and down > 0:
            middle = (centre[0] * 16, (centre[1] + dy * scale) * 16)
            axes = (across * scale * 8, down * scale * 8)
            cv2.ellipse(
                *(picture, tuple(map(round, middle)), tuple(map(round, axes)), 0, 0, 360),
                *(tuple(colour), -1, cv2.LINE_AA, 4),
            )

    ellipse(width, height, 0, (170, 90, 90))
    ellipse(0.8 * width, inner, 0, (50, 20, 20))
    ellipse(0.6 * width, 0.3 * inner * teeth, -0.3 * inner, (235, 230, 215))
    ellipse(0.5 * width, 0.4 * inner * tongue, 0.28 * inner, (180, 80, 85))
    soft = cv2.GaussianBlur(picture, (0, 0), max(0.3, 0.5 * scale)) * gain
    return np.clip(soft.round(), 0, 255).astype(np.uint8)


def _texture(rng: np.random.Generator, crop: tuple[int, int], weights: np.ndarray) -> TextureModel:
    w, h = max(8, crop[0] // 2), max(8, crop[1] // 2)
    axes, _ = np.linalg.qr(rng.normal(size=(h * w * 3, weights.shape[1])))
    y, x = np.mgrid[0:h, 0:w]
    fall = ((2 * x / (w - 1) - 1) ** 2 + (2 * y / (h - 1) - 1) ** 2) / 2
    return TextureModel(
        mean=rng.uniform(80, 160, h * w * 3).astype(np.float32),
        components=np.ascontiguousarray(axes.T, dtype=np.float32),
        eigenvalues=np.sort(weights.var(axis=0))[::-1].astype(np.float32),
        window=np.exp(-2 * fall).astype(np.float32),
        reference=np.full((h, w, 3), np.log(140), dtype=np.float32),
    )


def _costs(rng: np.random.Generator, shapes: np.ndarray, units: Units) -> CostModel:
    """Distances of the phonemes' shapes (equation 5), and scales from random pairs."""
    gamma = np.exp(0.1 * np.abs(np.arange(shapes.shape[1]) - shapes.shape[1]))
    apart = shapes[:, None] - shapes[None]
    distance = np.sqrt((gamma**2 * apart**2).sum(axis=2)) / gamma.sum()
    a, b = rng.integers(len(units), size=(2, 4000))
    a, b = a[a != b], b[a != b]
    apart = [
        np.linalg.norm(group[a] - group[b], axis=1)
        for group in feature_groups(units, units.pca.var(axis=0))
    ]
    # A database of silence shows no tongue: any scale will do for it.
    scales = np.array([max(1e-3, float(np.sqrt(np.mean(d**2)))) for d in apart])
    visual = np.mean([d / scale for d, scale in zip(apart, scales, strict=True)], axis=0)
    same = (units.viseme[a] == units.viseme[b]) & (units.viseme[a] != VISEME_OF[SILENCE])
    # Very small databases may have no two different frames of one spoken viseme.
    visual = visual[same] if same.any() else visual
    return CostModel(
        phoneme_distance=distance.astype(np.float32),
        target_scale=float(np.median(distance[distance > 0])),
        feature_scales=scales,
        visual_scale=max(1e-3, float(np.median(visual))),
    )
