"""What a stored mouth costs and loses in each codec and quality.

On the mouths of sharp portraits at 288 x 304 pixels (the largest that a database holds) and on
crops of filmed clips at the size that those carry: bytes a picture, PSNR (mean and worst) and
SSIM against the crop itself, and the time to encode and to decode one, medians, on one thread.
The portraits are in the folder named in UNITSEL_PORTRAITS, the clips in that named in
UNITSEL_CORPUS. JPEG XL is measured where the package imagecodecs is installed; databases do not
offer it.
"""

from __future__ import annotations

import importlib
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from analysis.clip import cut_crops, track_face
from analysis.face import FaceFinder
from analysis.models import find_models
from analysis.motion import estimate_poses, make_mask
from analysis.person import study_person
from database.mask import Camera, cut_crop
from database.pictures import DEFAULT_CODEC, decode, encode

Picture = npt.NDArray[np.uint8]

NAMES = (
    "png",
    *(f"jpeg:{q}" for q in (85, 90, 93, 95, 97)),
    *(f"webp:{q}" for q in (85, 90, 92, 95, 98)),
    *(f"avif:{q}" for q in (75, 80, 83, 85, 88, 92)),
)
JXL_DISTANCES = (0.5, 0.6, 0.7, 1.0)
LEAST_PSNR, MOST_BYTES = 42.0, 15_000
CLIPS, CLIP_STEP = 4, 12


@dataclass(frozen=True)
class Way:
    """A way to encode and decode."""

    name: str
    encode: Callable[[Picture], bytes]
    decode: Callable[[bytes], Picture]


@dataclass(frozen=True)
class Figures:
    """Of one way on one set of pictures: bytes, dB, SSIM, milliseconds."""

    size: float
    psnr: float
    worst: float
    ssim: float
    encoding: float
    decoding: float


def ways() -> list[Way]:
    """List the codecs of databases at some qualities, and JPEG XL if it can be had."""

    def own(name: str) -> Way:
        return Way(name, lambda p: encode(p, name), lambda data: decode(data, name))

    def jxl(other: Any, distance: float) -> Way:
        return Way(
            f"jxl d={distance}",
            lambda p: other.jpegxl_encode(p, distance=distance, effort=3, numthreads=1),
            lambda data: np.asarray(other.jpegxl_decode(data, numthreads=1)),
        )

    found = [own(name) for name in NAMES]
    try:
        other = importlib.import_module("imagecodecs")
    except ImportError:
        return found
    return [*found, *(jxl(other, d) for d in JXL_DISTANCES)]


def measure(way: Way, pictures: list[Picture]) -> Figures:
    """Encode and decode each picture."""
    rows = []
    for picture in pictures:
        began = time.perf_counter()
        data = way.encode(picture)
        between = time.perf_counter()
        back = way.decode(data)
        ended = time.perf_counter()
        error = max(float(np.mean((back.astype(np.float64) - picture) ** 2)), 1e-10)
        ssim = float(np.mean(cv2.quality.QualitySSIM_compute(picture, back)[0][:3]))
        psnr = 10 * np.log10(255**2 / error)
        rows.append((len(data), psnr, ssim, 1e3 * (between - began), 1e3 * (ended - between)))
    size, psnr, ssim, encoding, decoding = np.array(rows).T
    return Figures(
        float(size.mean()),
        float(psnr.mean()),
        float(psnr.min()),
        float(ssim.mean()),
        float(np.median(encoding)),
        float(np.median(decoding)),
    )


def portrait_mouths(folder: Path, finder: FaceFinder) -> list[Picture]:
    """Cut the mouths of the portraits below a folder, as a build would."""
    mouths = []
    for path in sorted(folder.rglob("*.jpg")):
        rgb = np.asarray(cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB), np.uint8)
        finder.reset()
        mesh = finder.find(rgb)
        if mesh is None:
            continue
        camera = Camera.assumed(rgb.shape[1], rgb.shape[0])
        mask = make_mask(mesh.points, camera)
        points = np.repeat(mesh.points[None, :, :2], 5, axis=0)
        poses, _ = estimate_poses(points, mask, camera)
        mouths.append(cut_crop(rgb, mask.patch, poses.matrix(2), camera))
    return mouths


def filmed_mouths(corpus: Path, finder: FaceFinder) -> list[Picture]:
    """Cut some mouths out of a corpus's first clips."""
    clips = sorted(p for p in corpus.iterdir() if p.suffix in (".mpg", ".mp4", ".mkv"))[:CLIPS]
    person = study_person(clips, finder)
    mask, camera = person.mask, person.camera
    mouths: list[Picture] = []
    for clip in clips:
        face = track_face(clip, mask, camera, finder)
        mouths.extend(list(cut_crops(clip, face, mask))[::CLIP_STEP])
    return mouths


def show(what: str, pictures: list[Picture]) -> None:
    """Print a table."""
    height, width = pictures[0].shape[:2]
    print(f"\n{len(pictures)} {what}, {width} x {height}")
    print("codec           kB  mean dB  worst dB    SSIM  encode ms  decode ms")
    fits = []
    for way in ways():
        way.decode(way.encode(pictures[0]))
        found = measure(way, pictures)
        psnr, worst = (f"{v:.1f}" if v < 100 else "exact" for v in (found.psnr, found.worst))
        mark = " <- default" if way.name == DEFAULT_CODEC else ""
        print(
            f"{way.name:<11} {found.size / 1e3:6.2f} {psnr:>8} {worst:>9} {found.ssim:7.4f} "
            f"{found.encoding:10.2f} {found.decoding:10.2f}{mark}"
        )
        if found.worst >= LEAST_PSNR:
            fits.append((found.size, way.name))
    if fits:
        size, name = min(fits)
        within = "within" if size <= MOST_BYTES else "over"
        print(
            f"smallest with {LEAST_PSNR:.0f} dB at worst: {name}, {size / 1e3:.2f} kB, "
            f"{within} {MOST_BYTES // 1000} kB"
        )


def main() -> int:
    """Print the tables of what is there."""
    cv2.setNumThreads(1)
    portraits = Path(os.environ.get("UNITSEL_PORTRAITS", "../shared/portraits"))
    corpus = Path(os.environ.get("UNITSEL_CORPUS", "../shared/corpus/grid-s1/build"))
    for folder, variable in ((portraits, "UNITSEL_PORTRAITS"), (corpus, "UNITSEL_CORPUS")):
        if not folder.is_dir():
            print(f"codecs: no folder {folder}; name one in {variable}")
    if portraits.is_dir():
        show("portraits", portrait_mouths(portraits, FaceFinder(find_models())))
    if corpus.is_dir():
        show("crops of clips", filmed_mouths(corpus, FaceFinder(find_models())))
    return 0


if __name__ == "__main__":
    sys.exit(main())
