"""Head motion: how true it is where it is known, and how still the face stands on real footage.

    python benchmarks/motion.py [--corpus CORPUS_DIR] [--clips N] [--strip STRIP.png]

Known motion: the mask of a real frame is drawn at prescribed poses, with noise, blur, moving light
and the mouths of other frames, and followed: once with the pose of the first frame given (the
paper's hand-marked start), once with the mask placed by the person's reference texture. "Motion
alone" takes one constant offset a clip out of the errors: where the mask sits on the face is no
motion, and a sentence is cut by it always alike.

Steadiness: on real clips the rigid surface is sampled by one sampler at each method's poses, and
the standard deviation over time of every point is averaged. The surface is a chessboard: gradients
are fitted on its white squares and judged on the black ones. The floor is what the same fit
reaches on the very squares that are judged: the noise and the compression of the footage, which
no motion can take away.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import numpy as np
import numpy.typing as npt

from analysis.corpus import find_clips
from analysis.face import FaceFinder
from analysis.gradient_kernels import sample_points
from analysis.gradient_motion import GradientTracker
from analysis.models import find_models
from analysis.motion import MotionSettings, estimate_poses
from analysis.person import Person, study_person
from analysis.photometric import Surface, rigid_surface
from analysis.rigid import Matrix, inverse, joined, to_six, usual_step
from analysis.surface_texture import face_picture
from database.mask import Camera, Mask, cut_crop
from database.media import read_video

sys.path.insert(0, str(Path(__file__).parent))
from moving_face import Disturbance, moving_face, prescribed_poses

FACE_WIDTH = (234, 454)
"""Mesh points at the face's sides."""

SQUARE = 5.0
"""mm: side of the chessboard's squares, four pixels on GRID."""

SPACING = 1.25
"""mm between the points at which steadiness is measured."""

KNOWN_CLIPS, KNOWN_FRAMES = 8, 60

CORPUS = Path(__file__).parent.parent.parent / "shared" / "corpus" / "grid-s1" / "build"

FIRST_SEED = 100
"""Of the prescribed motion: not those that settings were chosen with (0 to 7)."""


@dataclass(frozen=True)
class Footage:
    """A clip whose landmarks have been found."""

    name: str
    frames: list[npt.NDArray[np.uint8]]
    landmarks: npt.NDArray[np.float32]
    camera: Camera


def look(
    name: str, frames: Sequence[npt.NDArray[np.uint8]], finder: FaceFinder, camera: Camera
) -> Footage:
    """Find the landmarks of frames that all show a face; others are left out."""
    finder.reset()
    kept, points = [], []
    for frame in frames:
        mesh = finder.find(frame)
        if mesh is not None:
            kept.append(frame)
            points.append(mesh.points)
    height, width = kept[0].shape[:2]
    return Footage(name, kept, np.stack(points), camera.scaled_to(width, height))


@dataclass(frozen=True)
class Estimate:
    """Poses of a clip by both methods, and what gradients took, seconds a frame."""

    points: Matrix
    gradients: Matrix
    lost: int
    seconds: float


def follow(
    clip: Footage, person: Person, surface: Surface | None, first: Matrix | None = None
) -> Estimate:
    """Follow a clip's head by both methods."""
    found, good = estimate_poses(
        clip.landmarks[:, :, :2], person.mask, clip.camera, MotionSettings(method="points")
    )
    starts = np.stack([found.matrix(i) for i in range(len(found))])
    began = time.process_time()
    pictures = [
        face_picture(frame, points[:, :2], clip.camera)
        for frame, points in zip(clip.frames, clip.landmarks, strict=True)
    ]
    tracker = GradientTracker(person.mask, reference=person.reference, surface=surface)
    known = {} if first is None else {0: first}
    followed = tracker.follow(pictures, starts, good, known)
    seconds = (time.process_time() - began) / len(clip.frames)
    return Estimate(starts, followed.poses, int(followed.lost.sum()), seconds)


def errors(found: Matrix, truth: Matrix, mask: Mask) -> npt.NDArray[np.float64]:
    """Of each frame: degrees, % of the face's width across, % of the distance in depth, (n, 3)."""
    turned = [to_six(joined(inverse(f), t))[:3] for f, t in zip(found, truth, strict=True)]
    apart = found[:, :, 3] - truth[:, :, 3]
    one, other = mask.vertices[list(FACE_WIDTH)].astype(np.float64)
    width = float(np.linalg.norm(one - other))
    return np.column_stack(
        [
            np.degrees(np.linalg.norm(turned, axis=1)),
            100 * np.hypot(apart[:, 0], apart[:, 1]) / width,
            100 * np.abs(apart[:, 2]) / truth[:, 2, 3],
        ]
    )


def motion_alone(found: Matrix, truth: Matrix) -> Matrix:
    """Poses moved by one constant motion in the mask's frame, so that they fit the truth best."""
    offset = usual_step(found, truth)
    return np.stack([joined(pose, offset) for pose in found])


def known_motion(clips: Sequence[Footage], person: Person, finder: FaceFinder) -> None:
    """Print the errors on motion that is known."""
    rows: dict[tuple[int, str], list[npt.NDArray[np.float64]]] = {}
    lost = 0
    for seed, clip in enumerate(clips, FIRST_SEED):
        real = follow(clip, person, None).gradients
        truth = prescribed_poses(real[0], KNOWN_FRAMES, seed)
        pictures = moving_face(
            clip.frames, real, truth, person.mask, clip.camera, Disturbance(), seed
        )
        drawn = look(clip.name, pictures, finder, clip.camera)
        given = follow(drawn, person, None, truth[0])
        alone = follow(drawn, person, None)
        lost += given.lost
        ways = (
            ("gradients, first pose given", given.gradients),
            ("  motion alone", motion_alone(given.gradients, truth)),
            ("gradients, placed by reference", alone.gradients),
            ("  motion alone", motion_alone(alone.gradients, truth)),
            ("feature points over 7 frames", alone.points),
            ("  motion alone", motion_alone(alone.points, truth)),
        )
        for k, (name, poses) in enumerate(ways):
            rows.setdefault((k, name), []).append(errors(poses, truth, person.mask))
    print(f"Known motion: {len(clips)} clips of {KNOWN_FRAMES} frames, median (95th percentile)")
    print(f"{'':30} {'rotation, deg':>16} {'across, % width':>16} {'depth, % dist.':>16}")
    for (_, name), parts in rows.items():
        every = np.concatenate(parts)
        middle, high = np.median(every, axis=0), np.percentile(every, 95, axis=0)
        cells = [f"{m:.3f} ({h:.2f})" for m, h in zip(middle, high, strict=True)]
        print(f"{name:30} " + " ".join(f"{c:>16}" for c in cells))
    print(f"{'aim':30} {'0.200':>16} {'0.300':>16} {'0.300':>16}")
    print(f"frames lost: {lost}\n")


def unsteadiness(clip: Footage, poses: Matrix, surface: Surface) -> float:
    """Mean standard deviation over time of the surface's grey values."""
    camera = np.array([clip.camera.focal, clip.camera.cx, clip.camera.cy])
    values = np.empty((len(poses), len(surface)), np.float32)
    none = np.empty((0, 3), np.float32)
    for i, frame in enumerate(clip.frames):
        grey = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
        pose = np.ascontiguousarray(poses[i])
        sample_points(grey, camera, pose, surface.points, values[i], none)
    return float(np.nanmean(values.std(axis=0)))


def steadiness(clips: Sequence[Footage], person: Person) -> None:
    """Print how still the rigid texture stands on real footage."""
    surface = rigid_surface(person.mask, SPACING)
    white = surface.squares(SQUARE)
    fitted, judged = surface.part(white), surface.part(~white)
    rows, times, lost = [], [], 0
    for clip in clips:
        half, other = follow(clip, person, fitted), follow(clip, person, judged)
        whole = follow(clip, person, None)
        still = np.repeat(half.gradients[len(clip.frames) // 2][None], len(clip.frames), axis=0)
        ways = (still, half.points, half.gradients, other.gradients)
        rows.append([unsteadiness(clip, poses, judged) for poses in ways])
        times.append(whole.seconds)
        lost += whole.lost
    values = np.array(rows)
    mean = values.mean(axis=0)
    ratios = values[:, 2] / values[:, 1]
    frames = sum(len(c.frames) for c in clips)
    print(f"Steadiness: {len(clips)} clips, {frames} frames, on squares that were not fitted")
    print("standard deviation over time, grey values")
    names = ("motion switched off", "points over 7 frames", "gradients", "floor (fitted on them)")
    for name, value in zip(names, mean, strict=True):
        print(f"{name:30} {value:8.3f} {100 * (value / mean[1] - 1):+8.1f} %")
    print(f"{'aim':30} {0.65 * mean[1]:8.3f} {-35:+8.1f} %")
    over = np.sqrt(np.maximum(values[:, 1:3] ** 2 - values[:, 3:4] ** 2, 0)).mean(axis=0)
    print(f"beyond the floor, in squares: points {over[0]:.3f}, gradients {over[1]:.3f}")
    low, high = 100 * (ratios.min() - 1), 100 * (ratios.max() - 1)
    print(f"single clips: {low:+.0f} % to {high:+.0f} %; frames lost: {lost}")
    print(f"gradients take {1000 * np.median(times):.2f} ms a frame on one core")


def write_strip(path: Path, clip: Footage, person: Person, count: int = 8) -> None:
    """Write mouths of one clip side by side: motion switched off, by points, by gradients."""
    both = follow(clip, person, None)
    still = np.repeat(both.gradients[:1], len(clip.frames), axis=0)
    chosen = np.linspace(0, len(clip.frames) - 1, count).astype(int)
    rows = []
    for poses in (still, both.points, both.gradients):
        crops = [cut_crop(clip.frames[i], person.mask.patch, poses[i], clip.camera) for i in chosen]
        rows.append(np.hstack(crops))
    picture = cv2.resize(np.vstack(rows), None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(path), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))


def main() -> None:
    """Run both and print them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument(
        "--corpus", type=Path, default=Path(os.environ.get("UNITSEL_CORPUS", CORPUS))
    )
    parser.add_argument("--clips", type=int, default=12, metavar="N", help="clips for steadiness")
    parser.add_argument("--strip", type=Path, metavar="STRIP.png", help="write mouths of one clip")
    options = parser.parse_args()
    if not options.corpus.is_dir():
        print(f"needs footage: no folder {options.corpus}; set UNITSEL_CORPUS to one")
        return
    cv2.setNumThreads(1)
    finder = FaceFinder(find_models())
    videos = [c.media for c in find_clips(options.corpus, limit=options.clips)]
    person = study_person(videos, finder)
    clips = [
        look(v.stem, [f.rgb.copy() for f in read_video(v)], finder, person.camera) for v in videos
    ]
    known_motion(clips[:: max(1, len(clips) // KNOWN_CLIPS)][:KNOWN_CLIPS], person, finder)
    steadiness(clips, person)
    if options.strip:
        write_strip(options.strip, clips[0], person)


if __name__ == "__main__":
    main()
