"""What the eye would see of the stitching: rendered sentences beside the real recordings of them.

    python benchmarks/picture.py [DB.h5] [--own] [--sentences N] [--backgrounds N]
                                 [--sheet FILE.png]

Sentences of a folder of held-out clips (UNITSEL_HELDOUT) are rendered over several of the
database's own clips; with `--own`, for tuning, sentences of the database are, each without its
own recording. Printed are the measures of `render/picture_measures.py` as ratios to the real
recording of the same sentence:

* the gradient across the blend region's edge (at most 1.1),
* the sharpness of the mouth, variance of the Laplacian (0.9 to 1.1),
* the flicker of skin that is still,
* the samples outside the blend region that are not the background's (0).

Each is printed as well for the same pictures spoiled on purpose: it must fail there. Then the
colour between mouth and background: the difference left in the blend region and the time a frame,
without any matching, by the plane of gains of colour_baseline.py, and by the membrane of
render/colour_transfer.py. `--sheet` draws the widest open and the most closed mouths above real
frames of the same sentence, four times enlarged.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from colour_baseline import apply_gain, fit_gain

from analysis.corpus import find_clips
from database.mask import Camera, cut_crop, project
from database.media import probe, read_video
from database.planes import Colour, Planes, planes_to_rgb
from database.reader import UnitDatabase, open_database
from render.background import Background
from render.blend import blend_alpha, ring_weights
from render.colour_transfer import ColourTransfer
from render.picture_measures import (
    PictureScores,
    band_mismatch,
    changed_outside,
    picture_scores,
)
from render.scene import Scene
from render.sharpening import sharpen
from unitsel.likeness.evaluation import Evaluator
from unitsel.select import Selection
from unitsel.synthesizer import Synthesizer

UInt8Array = npt.NDArray[np.uint8]
Posed = list[tuple[Planes, npt.NDArray[np.float64]]]

SEED = 3


@dataclass(frozen=True)
class Sentence:
    """A selection, and the recording of the same sentence."""

    name: str
    selection: Selection
    real: Background


def main() -> None:
    """Measure and print."""
    options = _options()
    if not options.database.is_file():
        print(f"no database {options.database}: run make demo first, or name one")
        return
    with open_database(options.database) as db:
        synthesizer = Synthesizer(db)
        sentences = _own(synthesizer, options) if options.own else _heldout(synthesizer, options)
        if not sentences:
            print("no held-out clips: name a folder by UNITSEL_HELDOUT, or take --own")
            return
        # Played straight on: each frame's pose is then known.
        longest = max(len(s.selection.units) for s in sentences)
        others = np.random.default_rng(SEED).permutation(len(db.sequences))
        found = map(synthesizer.background, [None, *(db.sequences.media[i] for i in others)])
        long = (b for b in found if len(b) >= longest and b.fps == db.fps)
        backgrounds = list(islice(long, options.backgrounds))
        if not backgrounds:
            print(f"no clip of the database has {longest} frames with a face in a row")
            return
        _report(db, synthesizer, sentences, backgrounds, options.sheet)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="measure rendered pictures beside real ones")
    parser.add_argument("database", type=Path, nargs="?", default=Path("out/demo.h5"))
    parser.add_argument("--own", action="store_true")
    parser.add_argument("--sentences", type=int, default=8)
    parser.add_argument("--backgrounds", type=int, default=3)
    parser.add_argument("--sheet", type=Path)
    return parser.parse_args()


def _own(synthesizer: Synthesizer, options: argparse.Namespace) -> list[Sentence]:
    db = synthesizer.database
    taken = np.random.default_rng(SEED).choice(len(db.sequences), options.sentences, replace=False)
    return [
        Sentence(
            db.sequences.name[i],
            synthesizer.select(db.sequence_track(i), exclude_sequences=[i]),
            synthesizer.background(db.sequences.media[i]),
        )
        for i in map(int, taken)
    ]


def _heldout(synthesizer: Synthesizer, options: argparse.Namespace) -> list[Sentence]:
    folder = os.environ.get("UNITSEL_HELDOUT", "")
    if not Path(folder).is_dir() or not folder:
        return []
    evaluator = Evaluator(synthesizer.database)
    clips = find_clips(folder)
    step = max(1, len(clips) // options.sentences)
    return [
        Sentence(
            clip.name,
            synthesizer.select(evaluator.target(clip).track),
            synthesizer.background(clip.media),
        )
        for clip in clips[::step][: options.sentences]
    ]


def _report(
    db: UnitDatabase,
    synthesizer: Synthesizer,
    sentences: list[Sentence],
    backgrounds: list[Background],
    sheet: Path | None,
) -> None:
    alpha = blend_alpha(db.mask)
    info = probe(backgrounds[0].path)
    camera = db.camera.scaled_to(info.width, info.height)
    rng = np.random.default_rng(SEED)

    def scores(frames: Posed) -> PictureScores:
        return picture_scores(frames, db.mask, camera, alpha, info.colour)

    rows: dict[str, list[PictureScores]] = {}
    changed = samples = 0
    strips = []
    print(f"{'sentence':10s} {'background':10s}   seam  sharpness  flicker")
    for sentence in sentences:
        real = [(f, sentence.real.poses.matrix(i)) for i, f in enumerate(_frames(sentence.real))]
        reference = scores(real)
        for background in backgrounds:
            if background.path == sentence.real.path:
                continue
            under = _frames(background)
            made = list(synthesizer.render(sentence.selection, background=background))
            made = made[: len(under)]
            posed = [(p, background.poses.matrix(i)) for i, p in enumerate(made)]
            layers = _layers(db, alpha, background, len(made))
            changed += sum(
                changed_outside(p, u, a, x, y)
                for p, u, (a, x, y) in zip(made, under, layers, strict=False)
            )
            samples += sum(p.y.size * 3 // 2 for p in made)
            found = scores(posed).over(reference)
            print(
                f"{sentence.name:10s} {background.path.stem:10s} {found.seam:6.2f} "
                f"{found.sharpness:8.2f} {found.flicker:9.2f}"
            )
            rows.setdefault("rendered", []).append(found)
            for name, spoil in SPOILED.items():
                spoiled = [
                    (spoil(p.y, u.y, layer, rng), p.u, p.v)
                    for p, u, layer in zip(made, under, layers, strict=False)
                ]
                again = [(Planes(*p), pose) for p, (_, pose) in zip(spoiled, posed, strict=True)]
                rows.setdefault(name, []).append(scores(again).over(reference))
            if sheet is not None:
                strips.append(_strip(db, sentence, posed, real, info.colour, camera))
    print(f"\n{'mean of':22s}   seam  sharpness  flicker")
    for name, of in rows.items():
        seam, sharp, still = (
            np.mean([getattr(s, f) for s in of]) for f in ("seam", "sharpness", "flicker")
        )
        fails = [] if seam <= 1.1 else ["seam"]
        fails += [] if 0.9 <= sharp <= 1.1 else ["sharpness"]
        fails += [] if still <= 1.1 else ["flicker"]
        verdict = "fails " + ", ".join(fails) if fails else "passes"
        print(f"{name:22s} {seam:6.2f} {sharp:8.2f} {still:9.2f}   {verdict}")
    print(f"\nsamples outside the blend region that changed: {changed} of {samples}")
    _colour(db, sentences, backgrounds, alpha)
    if sheet is not None:
        cv2.imwrite(str(sheet), np.concatenate(strips)[..., ::-1])
        print(f"{sheet}: rendered above real, a pair of rows for each line of the table")


def _frames(background: Background) -> list[Planes]:
    """All its frames, decoded."""
    n = len(background)
    kept = []
    for frame in read_video(background.source, background.fps):
        if frame.index >= background.first:
            kept.append(frame.planes)
        if len(kept) == n:
            break
    return kept


Layer = tuple[npt.NDArray[np.float32], int, int]


def _layers(
    db: UnitDatabase, alpha: npt.NDArray[np.float32], background: Background, n: int
) -> list[Layer]:
    """Blend weights in the pictures of a background, and where they begin."""
    info = probe(background.path)
    patch, camera = db.mask.patch, db.camera.scaled_to(info.width, info.height)
    blank = np.zeros((patch.crop_height, patch.crop_width, 3), np.uint8)
    found = []
    with Scene(info.width, info.height, patch, camera, alpha) as scene:
        for i in range(n):
            layer = scene.draw(blank, background.poses.matrix(i))
            found.append((layer.alpha, layer.x0, layer.y0))
    return found


def _spoiled(
    change: Callable[[npt.NDArray[np.float32], UInt8Array, np.random.Generator], UInt8Array],
) -> Callable[[UInt8Array, UInt8Array, Layer, np.random.Generator], UInt8Array]:
    """A way to spoil a picture's luma, from one that spoils the part that the layer covers."""

    def spoil(y: UInt8Array, _: UInt8Array, layer: Layer, rng: np.random.Generator) -> UInt8Array:
        alpha, x0, y0 = layer
        out = y.copy()
        part = out[y0 : y0 + alpha.shape[0], x0 : x0 + alpha.shape[1]]
        made = change(alpha, part.copy(), rng)
        np.copyto(part, made, where=alpha > 0)
        return out

    return spoil


def _levels(values: npt.NDArray[np.floating]) -> UInt8Array:
    return np.asarray(np.clip(np.rint(values), 0, 255), dtype=np.uint8)


def _boxed(alpha: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """A rectangle whose sides lie in the fade."""
    rows, columns = (np.flatnonzero((alpha > 0.5).any(axis=a)) for a in (1, 0))
    box = np.zeros(alpha.shape, dtype=bool)
    box[rows[0] + 1 : rows[-1], columns[0] + 1 : columns[-1]] = True
    return box


SPOILED = {
    "blurred": _spoiled(lambda a, y, r: _levels(cv2.GaussianBlur(y.astype(np.float32), None, 0.8))),
    "noisy": _spoiled(lambda a, y, r: _levels(y + r.normal(0, 3, y.shape))),
    "pasted box, 10 lighter": _spoiled(lambda a, y, r: _levels(y + 10.0 * _boxed(a))),
    "edge without fade": _spoiled(lambda a, y, r: _levels(y + 8.0 * (a > 0.5))),
    "light that jumps": _spoiled(lambda a, y, r: _levels(y + a * r.normal(0, 3))),
}


def _colour(
    db: UnitDatabase,
    sentences: list[Sentence],
    backgrounds: list[Background],
    alpha: npt.NDArray[np.float32],
) -> None:
    """What is left between mouth and background, and what it takes."""
    ring, transfer = ring_weights(alpha), ColourTransfer(alpha)
    ways: dict[str, Callable[[UInt8Array, UInt8Array], UInt8Array]] = {
        "as they are": lambda frame, unit: unit,
        "plane (baseline)": lambda frame, unit: apply_gain(unit, fit_gain(frame, unit, ring)),
        "membrane": lambda frame, unit: transfer.apply(unit, transfer.field(frame, unit)),
        "membrane, sharpened": lambda frame, unit: transfer.apply(
            sharpen(unit, 0.2), transfer.field(frame, unit)
        ),
    }
    left: dict[str, list[float]] = {name: [] for name in ways}
    took: dict[str, list[float]] = {name: [] for name in ways}
    for background in backgrounds:
        info = probe(background.path)
        camera = db.camera.scaled_to(info.width, info.height)
        frames = _frames(background)
        for sentence in sentences:
            n = min(len(frames), len(sentence.selection.units))
            for i in range(0, n, 6):
                pose = background.poses.matrix(i)
                rgb = planes_to_rgb(frames[i], info.colour)
                seen = cut_crop(rgb, db.mask.patch, pose, camera)
                unit = db.picture(int(sentence.selection.units[i]))
                for name, way in ways.items():
                    begun = time.perf_counter()
                    made = way(seen, unit)
                    took[name].append(time.perf_counter() - begun)
                    left[name].append(band_mismatch(made, seen, alpha))
    base = float(np.median(took["plane (baseline)"]))
    print(f"\n{'colour in the blend region':26s}  levels left     ms a frame")
    for name in ways:
        median = float(np.median(took[name]))
        told = f"{median * 1000:8.3f}" + (f"  1/{base / median:.1f}" if median > 1e-5 else "")
        print(f"{name:26s} {np.mean(left[name]):11.2f} {told:>18s}")


def _strip(
    db: UnitDatabase,
    sentence: Sentence,
    made: Posed,
    real: Posed,
    colour: Colour,
    camera: Camera,
) -> UInt8Array:
    """Open and closed mouths of a sentence, rendered above real, four times enlarged."""
    opening = db.units.inner_opening[sentence.selection.units[: min(len(made), len(real))]]
    order = np.argsort(opening)
    places = [int(order[i]) for i in (-1, -4, -8, len(order) // 2, 2, 0)]
    rows = [
        np.concatenate([_enlarged(*frames[i], colour, camera) for i in places], axis=1)
        for frames in (made, real)
    ]
    return np.concatenate(rows)


def _enlarged(
    planes: Planes, pose: npt.NDArray[np.float64], colour: Colour, camera: Camera
) -> UInt8Array:
    corners = project(np.array([[-60.0, 20, 0], [60, 135, 0]]), pose, camera)
    (x0, y0), (x1, y1) = np.clip(np.rint(corners).astype(int), 0, (planes.width, planes.height))
    part = planes_to_rgb(planes, colour)[y0:y1, x0:x1]
    return np.asarray(cv2.resize(part, (400, 384), interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


if __name__ == "__main__":
    main()
