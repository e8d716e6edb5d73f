"""The lip model: how true it is where the lips are known, and how still it is where they rest.

    python benchmarks/lips.py DB.h5 [PORTRAITS_DIR] [--clips N] [--lip-points FILE] [--plots DIR]

With points marked by hand (grid_s1_lips.csv: 20 frames of GRID's first speaker) the model is
trained on them instead of on the face mesh's. Where those frames are of the held-back half, they
count there too. Else a model is built on half of the clips; what is printed is of the others.

Known warps: frames are moved, turned, scaled and bent by smooth random fields that are not made
from the model, and noise is added; the lips of the bent frame are compared with those of the
frame as it was, bent likewise. The fit starts from the face mesh of the frame as it was. Pixels
are those of the paper's crops, 288 across.

Rest: silences of at least 0.3 s in which the mouth's pictures stay alike. Jitter is the standard
deviation of the mouth height's second difference over the root of six, nothing smoothed, all of
it on the same frames with the same poses. "Face mesh, one look" is what the network gives;
"averaged" is what a database stores, the mean of three looks (analysis/face.py).

Portraits: neutral faces with points set by hand (Face Research Lab London Set); every fourth
person is held back. The error is the distance of the marked points from the contour, in percent
of the mouth's width.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import numpy as np
import numpy.typing as npt

from analysis.aam import to_vector
from analysis.aam_fit import LipFit, LipFitter, fit_clip
from analysis.aam_points import (
    contours_of_points,
    marks_in_crop,
    points_of_contours,
    read_marks,
)
from analysis.aam_training import choose_frames, train_lip_model
from analysis.face import FaceFinder, FaceSettings
from analysis.lips import lip_geometry
from analysis.models import find_models
from analysis.texture import describe_clip, fit_texture, mean_log, reduce_crop
from database.mask import OUTER_LIPS, Poses
from database.media import probe, read_video
from database.phonemes import SILENCE
from database.reader import UnitDatabase, open_database

sys.path.insert(0, str(Path(__file__).parent))
from lip_plots import write_overlays
from marked_lips import compare_marked

F64 = npt.NDArray[np.float64]

PAPER_WIDTH = 288
"""Pixels across the paper's crops."""

WARPED, NOISE = 60, 2.0
"""Frames that are bent; levels of the noise added to them."""

BENDING, REACH = 1.0, 40.0
"""Standard deviation of the bending (pixels at 288) and of the blur that makes it smooth."""

ALIKE = 0.15
"""Greatest change of the mouth's picture across a moment of rest, in parts of all its change."""

WINDOW, SHORTEST = 4, 8
"""Frames on each side that are compared, and of a stretch of rest."""


@dataclass(frozen=True)
class Look:
    """A clip as the model sees it.

    Parameters
    ----------
    crops : (n, h, w, 3) uint8
    contours, single : (n, 40, 2) float64
        Lips of the face mesh in crop pixels: averaged over three looks, and of one look.
    numbers : (n,) int
    quiet, speech : (n,) bool
        Frames of silences of 0.3 s and more; frames from the first to the last phone.
    """

    crops: npt.NDArray[np.uint8]
    contours: F64
    single: F64
    numbers: npt.NDArray[np.int32]
    quiet: npt.NDArray[np.bool_]
    speech: npt.NDArray[np.bool_]


def look(db: UnitDatabase, sequence: int, plain: FaceFinder | None) -> Look:
    """Read one clip of a database; without a finder the one look is the averaged."""
    first = int(db.sequences.first_unit[sequence])
    rows = np.arange(first, first + int(db.sequences.units[sequence]))
    numbers = db.units.frame[rows]
    poses = Poses(db.units.rotation[rows], db.units.translation[rows])
    landmarks = db.landmarks(rows)
    media = Path(db.sequences.media[sequence])
    info = probe(media) if plain is not None else None
    once = landmarks
    if plain is not None:
        plain.reset()
        meshes = {f.index: plain.find(f.rgb) for f in read_video(media)}
        looked = [meshes.get(int(number)) for number in numbers]
        once = np.stack(
            [a if m is None else m.points[:, :2] for a, m in zip(landmarks, looked, strict=True)]
        )
    camera = db.camera if info is None else db.camera.scaled_to(info.width, info.height)
    contours = [
        db.mask.patch.to_crop(lip_geometry(points, poses, db.mask, camera, numbers, 1).contours)
        for points in (landmarks, once)
    ]
    track = db.sequence_track(sequence)
    times = (numbers + 0.5) / db.fps
    edges, spoken = track.boundaries, np.flatnonzero(track.phonemes != SILENCE)
    quiet = np.zeros(len(times), bool)
    for start, end, phoneme in zip(edges[:-1], edges[1:], track.phonemes, strict=True):
        if phoneme == SILENCE and end - start >= 0.3:
            quiet |= (times >= start) & (times <= end)
    speech = (times >= edges[spoken[0]]) & (times <= edges[spoken[-1] + 1])
    return Look(db.pictures(rows), contours[0], contours[1], numbers, quiet, speech)


def read_marked_frames(
    db: UnitDatabase, file: Path
) -> list[tuple[npt.NDArray[np.uint8], F64, F64]]:
    """Crop, the face mesh's points and the hand's points of the marked frames."""
    marks, found = read_marks(file), []
    for name in sorted({clip for clip, _ in marks} & set(db.sequences.name)):
        sequence = db.sequences.name.index(name)
        one = look(db, sequence, None)
        first = int(db.sequences.first_unit[sequence])
        rows = np.arange(first, first + len(one.crops))
        own = {number: points for (clip, number), points in marks.items() if clip == name}
        poses = Poses(db.units.rotation[rows], db.units.translation[rows])
        in_crop = marks_in_crop(own, poses, one.numbers, db.mask, db.camera)
        found += [
            (one.crops[i], points_of_contours(one.contours[i]), points)
            for i, points in in_crop.items()
        ]
    return found


def known_warps(fitter: LipFitter, held: list[Look]) -> None:
    """Print the error under warps that are known."""
    rng = np.random.default_rng(0)
    frames = [(one, i) for one in held for i in range(len(one.crops))]
    chosen = [frames[k] for k in np.linspace(0, len(frames) - 1, WARPED).astype(int)]
    height, width = held[0].crops.shape[1:3]
    to_paper = PAPER_WIDTH / width
    modes = fitter.model.shape_modes.astype(np.float64)
    errors, motions, beyond = [], [], []
    for one, i in chosen:
        crop, start = one.crops[i], points_of_contours(one.contours[i])
        lips, _, _ = fitter.fit(crop, start)
        source = random_warp(rng, height, width)
        picture = cv2.remap(
            crop.astype(np.float32),
            source[..., 0],
            source[..., 1],
            cv2.INTER_LANCZOS4,
            borderMode=cv2.BORDER_REPLICATE,
        )
        noisy = picture + rng.normal(0, NOISE, picture.shape)
        bent = np.clip(np.round(noisy), 0, 255).astype(np.uint8)
        truth = moved_by(source, lips)
        found, _, _ = fitter.fit(bent, start)
        errors.append(np.linalg.norm(found - truth, axis=1) * to_paper)
        motions.append(np.linalg.norm(truth - lips, axis=1) * to_paper)
        motion = to_vector(truth - lips)
        beyond.append(np.linalg.norm(motion - modes.T @ (modes @ motion)) / np.linalg.norm(motion))
    error = np.array(errors)
    print(f"known warps, {WARPED} frames held back, noise of {NOISE:g} levels, px at {PAPER_WIDTH}")
    print(f"  the points are moved by     {np.mean(motions):.2f}")
    print(f"  not spanned by components   {100 * np.mean(beyond):.0f} % of that")
    print(
        f"  mean point error            {error.mean():.3f}   (median {np.median(error):.3f}, outer "
        f"{error[:, :12].mean():.3f}, inner {error[:, 12:].mean():.3f})   bar 0.2"
    )


def random_warp(rng: np.random.Generator, height: int, width: int) -> npt.NDArray[np.float32]:
    """Where each pixel of a bent picture comes from, (h, w, 2)."""
    scale = width / PAPER_WIDTH
    fields = rng.normal(size=(2, height, width)).astype(np.float32)
    smooth = [cv2.GaussianBlur(f, (0, 0), REACH * scale) for f in fields]
    y, x = np.mgrid[:height, :width].astype(np.float64)
    angle, size = rng.normal(0, 0.03), np.exp(rng.normal(0, 0.03))
    shift = rng.normal(0, 3.0, 2) * scale
    c, s = size * np.cos(angle), size * np.sin(angle)
    u, v = x - width / 2, y - height / 2
    whole = (c * u - s * v + width / 2 + shift[0], s * u + c * v + height / 2 + shift[1])
    bent = [w + BENDING * scale * f / f.std() for w, f in zip(whole, smooth, strict=True)]
    return np.stack(bent, axis=-1).astype(np.float32)


def moved_by(source: npt.NDArray[np.float32], points: F64) -> F64:
    """Where points of a picture are in the bent one."""
    there = points.copy()
    for _ in range(60):
        x, y = (np.ascontiguousarray(there[:, k : k + 1], np.float32) for k in (0, 1))
        from_there = cv2.remap(source, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        there -= np.asarray(from_there, dtype=np.float64)[:, 0] - points
    return there


def rest(held: list[Look], fits: list[LipFit], weights: list[F64], spread: float) -> None:
    """Print jitter at rest and agreement in speech."""
    kinds = ("lip model", "face mesh, averaged", "face mesh, one look")
    jitter: list[tuple[float, ...]] = []
    frames = 0
    both: list[tuple[float, float]] = []
    speaking: list[tuple[F64, F64]] = []
    for one, fit, described in zip(held, fits, weights, strict=True):
        heights = [height_of(c) for c in (contours_of_points(fit.points), one.contours, one.single)]
        both.append(
            tuple(  # type: ignore[arg-type]
                np.corrcoef(heights[0][one.speech], h[one.speech])[0, 1] for h in heights[1:]
            )
        )
        speaking.append((heights[0][one.speech], heights[1][one.speech]))
        for first, last in resting(one, described, ALIKE * spread):
            jitter.append(tuple(shake(h[first:last]) for h in heights))
            frames += last - first
    ours, mesh = (np.concatenate(h) for h in zip(*speaking, strict=True))
    # A contour that moves more shakes more: all are brought to the motion of the mesh.
    gain = float(ours.std() / mesh.std())
    table = np.array(jitter) / [gain, 1, 1] * PAPER_WIDTH / held[0].crops.shape[2]
    print(f"lips at rest, {len(table)} stretches, {frames} frames: jitter of the height, px at 288")
    for k, kind in enumerate(kinds):
        share = np.sqrt((table[:, 0] ** 2).mean() / (table[:, k] ** 2).mean())
        print(
            f"  {kind:<20} median {np.median(table[:, k]):.3f}  rms "
            f"{np.sqrt((table[:, k] ** 2).mean()):.3f}"
            + (f"   lip model / this {share:.2f}" if k else "")
        )
    print("in speech: correlation of the height with the face mesh's, mean over clips, bar 0.95")
    for k, kind in enumerate(kinds[1:]):
        values = np.array([b[k] for b in both])
        print(f"  {kind:<20} {values.mean():.3f}  (least {values.min():.3f})")


def height_of(contours: npt.NDArray[np.floating]) -> F64:
    """Extent of the outer contour from top to bottom, (n,)."""
    y = np.asarray(contours, dtype=np.float64)[:, : len(OUTER_LIPS), 1]
    return np.asarray(y.max(axis=1) - y.min(axis=1))


def shake(values: F64) -> float:
    """Standard deviation of the second difference over the root of six."""
    return float(np.diff(values, 2).std() / np.sqrt(6))


def resting(one: Look, weights: F64, limit: float) -> list[tuple[int, int]]:
    """Stretches of silence in which the picture before and after each frame is alike."""
    n = len(weights)
    still = np.zeros(n, bool)
    for i in range(WINDOW, n - WINDOW):
        near = slice(i - WINDOW, i + WINDOW + 1)
        change = weights[i + 1 : i + 1 + WINDOW].mean(axis=0) - weights[i - WINDOW : i].mean(axis=0)
        unbroken = one.numbers[near][-1] - one.numbers[near][0] == 2 * WINDOW
        still[i] = one.quiet[near].all() and unbroken and np.linalg.norm(change) < limit
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    pairs = edges.reshape(-1, 2).tolist()
    return [(first, last) for first, last in pairs if last - first >= SHORTEST]


def main() -> None:
    """Build a model, and print what it is worth."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("database", type=Path, nargs="?", metavar="DB.h5", help="of real footage")
    parser.add_argument("portraits", type=Path, nargs="?", metavar="PORTRAITS_DIR")
    parser.add_argument("--clips", type=int, default=48, metavar="N", help="half of them train")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="write overlays")
    parser.add_argument("--lip-points", type=Path, metavar="FILE.csv", help="train on these")
    options = parser.parse_args()
    path = options.database or Path("out/demo.h5")
    if not path.is_file():
        print(f"{path} is not there; build a database, or name one")
        return
    cv2.setNumThreads(1)
    finder = FaceFinder(find_models())
    plain = FaceFinder(find_models(), FaceSettings(looks=()))
    with open_database(path) as db:
        taken_in = np.linspace(0, len(db.sequences) - 1, min(options.clips, len(db.sequences)))
        recorded = all(Path(m).is_file() for m in db.sequences.media)
        looks = [look(db, int(s), plain if recorded else None) for s in taken_in]
        marked = read_marked_frames(db, options.lip_points) if options.lip_points else []
    reduced = [np.stack([reduce_crop(c) for c in one.crops]) for one in looks]
    training, held = looks[::2], looks[1::2]
    reference = np.mean([mean_log(r) for r in reduced[::2]], axis=0)
    pictures = np.concatenate(reduced[::2]).astype(np.float32)
    heights = np.concatenate([height_of(one.contours) for one in training])
    texture = fit_texture(pictures, heights.astype(np.float32), reference)
    weights = [describe_clip(r, texture)[:, :8].astype(np.float64) for r in reduced]
    spread = float(np.sqrt(texture.eigenvalues[:8].sum()))

    frames = [(one, i) for one in training for i in range(len(one.crops))]
    chosen = [frames[k] for k in choose_frames(np.concatenate(weights[::2]), 40)]
    crops = [m[0] for m in marked] or [one.crops[i] for one, i in chosen]
    mesh = [m[1] for m in marked] or [points_of_contours(one.contours[i]) for one, i in chosen]
    points = [m[2] for m in marked] or mesh
    started = time.perf_counter()
    trained = train_lip_model(
        crops,
        np.stack(points),
        marked=np.full(len(crops), bool(marked)),
        starts=np.stack(mesh),
    )
    source = "marked by hand" if marked else f"of {len(training)} clips"
    print(
        f"model: {len(crops)} frames {source}, built in "
        f"{time.perf_counter() - started:.1f} s (the first time with compilation); points moved "
        f"by {', '.join(f'{m:.2f}' for m in trained.moved)} px of the crop"
    )
    fitter = LipFitter(trained.model)
    starts = [points_of_contours(one.contours) for one in held]
    fit_clip(fitter, held[0].crops[:2], starts[0][:2], [0, 1])
    began = time.process_time()
    fits = [
        fit_clip(fitter, one.crops, start, one.numbers)
        for one, start in zip(held, starts, strict=True)
    ]
    taken = (time.process_time() - began) / sum(len(f.points) for f in fits)
    lost = sum(int((~f.found).sum()) for f in fits)
    print(f"fit: {1000 * taken:.2f} ms a frame on one core (bar 1.5), {lost} frames not found")
    known_warps(fitter, held)
    rest(held, fits, weights[1::2], spread)
    if options.portraits:
        compare_marked(options.portraits, finder)
    if options.plots:
        contours = [contours_of_points(f.points) for f in fits]
        write_overlays(
            options.plots / "lips.png",
            np.concatenate([one.crops for one in held]),
            np.concatenate(contours),
            np.concatenate([one.contours for one in held]),
        )


if __name__ == "__main__":
    main()
