"""Lips that people have marked: the lip model and the face mesh against a hand's points.

The portraits are those of the Face Research Lab London Set (DeBruine and Jones, CC BY 4.0):
``neutral/*.jpg``, and beside each a ``.tem`` file with 189 points, of which 87 to 108 are the
lips.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from analysis.aam_fit import LipFitter
from analysis.aam_points import contours_of_points, points_of_contours
from analysis.aam_training import train_lip_model
from analysis.face import FaceFinder
from analysis.lips import lip_geometry
from analysis.motion import MotionSettings, estimate_poses, make_mask
from database.mask import OUTER_LIPS, Camera, crop_map, cut_crop

F64 = npt.NDArray[np.float64]

FIRST, LAST = 87, 108
"""Points of the lips in a ``.tem`` file, counted from 0."""

OUTER = (*range(7), *range(17, 22))
"""Of these 22 the outer contour's: upper edge from corner to corner, then the lower edge."""

INNER = tuple(range(7, 17))
"""The inner contour's: five above, five below; the corners are not among them."""


@dataclass(frozen=True)
class Marked:
    """A portrait's mouth.

    Parameters
    ----------
    crop : (h, w, 3) uint8
    mesh : (40, 2) float64
        Contours of the face mesh, crop pixels.
    marks : (22, 2) float64
        The hand's points, crop pixels.
    """

    crop: npt.NDArray[np.uint8]
    mesh: F64
    marks: F64


def compare_marked(folder: Path, finder: FaceFinder) -> None:
    """Print the errors of the lip model and of the face mesh; each person is held back once."""
    people = [read_marked(p, finder) for p in sorted(folder.rglob("neutral/*.jpg"))]
    if len(people) < 20:
        print(f"portraits: {folder} holds {len(people)} neutral faces; at least 20 are needed")
        return
    rows = []
    for part in range(4):
        held = [i for i in range(len(people)) if i % 4 == part]
        others = [p for i, p in enumerate(people) if i % 4 != part]
        trained = train_lip_model(
            [p.crop for p in others],
            np.stack([twenty(p.marks) for p in others]),
            marked=np.ones(len(others), bool),
            starts=np.stack([points_of_contours(p.mesh) for p in others]),
        )
        fitter = LipFitter(trained.model)
        for i in held:
            start = points_of_contours(people[i].mesh)
            found, _, _ = fitter.fit(people[i].crop, start)
            moved = fitter.expected(start)
            contours = (
                contours_of_points(found[None])[0],
                people[i].mesh,
                contours_of_points(moved[None])[0],
            )
            rows.append((part, [distances(c, people[i].marks) for c in contours]))
    held_back = sum(part == 0 for part, _ in rows)
    print(
        f"portraits: distance of the marked points from the contour, % of the mouth's width, median"
        f"\n  {'':<32} {len(people) - held_back} train, {held_back} test   all four parts   "
        "(outer, inner)"
    )
    for k, kind in enumerate(("lip model", "face mesh", "face mesh, its mean error out")):
        first = np.concatenate([np.concatenate(r[k]) for part, r in rows if part == 0])
        outer, inner = (np.concatenate([r[k][e] for _, r in rows]) for e in (0, 1))
        print(
            f"  {kind:<32} {np.median(first):>12.2f} "
            f"{np.median(np.concatenate([outer, inner])):>16.2f}   "
            f"({np.median(outer):.2f}, {np.median(inner):.2f})"
        )


def read_marked(path: Path, finder: FaceFinder) -> Marked:
    """A portrait's mouth cut out, with its mesh and its marks."""
    picture = np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR_RGB), dtype=np.uint8)
    lines = path.with_suffix(".tem").read_text().split("\n")[1 + FIRST : 2 + LAST]
    marks = np.array([[float(v) for v in line.split()] for line in lines])
    finder.reset()
    mesh = finder.find(picture)
    assert mesh is not None, path
    camera = Camera.assumed(picture.shape[1], picture.shape[0])
    mask = make_mask(mesh.points, camera)
    landmarks = mesh.points[None, :, :2]
    once = MotionSettings(smoothing=1)
    poses, _ = estimate_poses(landmarks, mask, camera, once)
    pose = poses.matrix(0)
    lips = lip_geometry(landmarks, poses, mask, camera, [0], 1)
    source = crop_map(mask.patch, pose, camera)
    return Marked(
        cut_crop(picture, mask.patch, pose, camera),
        mask.patch.to_crop(lips.contours)[0],
        in_crop(source, marks),
    )


def in_crop(source: npt.NDArray[np.float32], points: F64) -> F64:
    """Where points of a picture are in its crop: the crop's map turned round, step by step."""
    height, width = source.shape[:2]
    scale = (source[height // 2, -1, 0] - source[height // 2, 0, 0]) / (width - 1)
    there = np.tile([width / 2, height / 2], (len(points), 1))
    for _ in range(40):
        x, y = (np.ascontiguousarray(there[:, k : k + 1], np.float32) for k in (0, 1))
        seen = cv2.remap(source, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        there -= (np.asarray(seen, dtype=np.float64)[:, 0] - points) / scale
    return there


def twenty(marks: F64) -> F64:
    """The model's 20 points of the 22 marked ones; inner corners lie between the marks."""
    left = 0.6 * marks[0] + 0.2 * (marks[7] + marks[12])
    right = 0.6 * marks[6] + 0.2 * (marks[11] + marks[16])
    outer = (marks[:7], marks[21:16:-1])
    return np.concatenate([*outer, [left], marks[8:11], [right], marks[15:12:-1]])


def distances(contours: F64, marks: F64) -> tuple[F64, F64]:
    """Distances of the outer and inner marks from contours of 40, % of the mouth's width."""
    width = np.linalg.norm(marks[6] - marks[0]) / 100
    outer, inner = np.split(contours, [len(OUTER_LIPS)])
    return (
        from_contour(marks[list(OUTER)], outer) / width,
        from_contour(marks[list(INNER)], inner) / width,
    )


def from_contour(points: F64, contour: F64) -> F64:
    """Distances of points from a closed polygon, (n,)."""
    edges = np.roll(contour, -1, axis=0) - contour
    away = points[:, None] - contour
    lengths = np.maximum((edges**2).sum(axis=1), 1e-12)
    along = np.clip((away * edges).sum(axis=2) / lengths, 0, 1)
    out: F64 = np.linalg.norm(away - along[..., None] * edges, axis=2).min(axis=1)
    return out
