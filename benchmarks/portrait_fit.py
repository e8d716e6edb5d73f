"""How true a portrait's mask is to lips and lids that people marked, beside the raw face mesh.

    python benchmarks/portrait_fit.py [PORTRAITS_DIR] [--all] [--plots DIR]

Neutral faces of the Face Research Lab London Set (DeBruine and Jones, CC BY 4.0): ``neutral/*.jpg``
with a ``.tem`` file each. Printed are every fourth person's, as in lips.py; the mean errors that
`analysis.portrait_lips` and `analysis.portrait_lids` take out, and their settings, come from the
others (`--all` prints those too). Nothing is touched by hand.

The error of lips is the distance of the marked points from the mask's contours, in percent of the
mouth's width; of lids, of the marked points from the mask's outline of the eye, in percent of the
eye's width. The raw face mesh is what the network gives in one look; "averaged" is the mean of
the looks that the mask starts from. "Contour" is the fitted curve before it is brought down to
the mask's points.

Without the pictures it says so.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from analysis.face import FaceFinder, FaceSettings
from analysis.models import find_models
from analysis.portrait import LOOKS, PortraitSettings, portrait_of
from analysis.portrait_lips import find_lips
from database.mask import INNER_LIPS, OUTER_LIPS
from database.portrait_mesh import (
    INNER_LIPS as MASK_INNER,
)
from database.portrait_mesh import (
    LEFT_EYE,
    MESH_INDEX,
    N_MASK,
    RIGHT_EYE,
)
from database.portrait_mesh import (
    OUTER_LIPS as MASK_OUTER,
)
from render.portrait_scene import PortraitScene
from unitsel.plots import strip
from unitsel.portrait.keyframes import JAWS, MOUTH_FRAMES

sys.path.insert(0, str(Path(__file__).parent))  # `make bench` leaves a script's folder out

from marked_lips import FIRST, INNER, LAST, OUTER, from_contour

F64 = npt.NDArray[np.float64]

DEFAULT = Path("..") / "shared" / "portraits" / "london"

EVERY = 4
"""Of so many people one is printed."""

EYES = ((18, 19, 20, 21, 22, 28, 29, 30), (23, 24, 25, 26, 27, 31, 32, 33))
"""Marked points of the lids, left and right in the picture, corners included."""


@dataclass
class Errors:
    """Distances in percent, of one way of finding lips or lids."""

    name: str
    outer: list[F64]
    inner: list[F64]

    def __str__(self) -> str:
        outer, inner = (np.concatenate(e) if e else np.zeros(0) for e in (self.outer, self.inner))
        both = np.concatenate([outer, inner])
        parts = f"({np.median(outer):.2f}, {np.median(inner):.2f})" if len(inner) else ""
        return (
            f"  {self.name:<28} median {np.median(both):5.2f} {parts:<14} "
            f"mean {both.mean():5.2f}   95th percentile {np.percentile(both, 95):5.2f}"
        )


def read_marks(photo: Path) -> F64:
    """All 189 marked points of a photo."""
    lines = photo.with_suffix(".tem").read_text().split("\n")
    return np.array([[float(v) for v in line.split()] for line in lines[1:190]])


def compare(photos: list[Path]) -> None:
    """Print the errors on some people."""
    models = find_models()
    once = FaceFinder(models, FaceSettings(looks=()))
    averaged = FaceFinder(models, FaceSettings(looks=LOOKS))
    ways = [
        Errors(name, [], [])
        for name in ("raw face mesh, one look", "face mesh, averaged", "contour", "mask")
    ]
    lids = [Errors(name, [], []) for name in ("raw face mesh, one look", "mask")]
    for photo in photos:
        picture = np.asarray(cv2.imread(str(photo), cv2.IMREAD_COLOR_RGB), dtype=np.uint8)
        marks = read_marks(photo)
        lips = marks[FIRST : LAST + 1]
        width = float(np.linalg.norm(lips[6] - lips[0])) / 100
        meshes = []
        for finder in (once, averaged):
            finder.reset()
            mesh = finder.find(picture)
            assert mesh is not None, photo
            meshes.append(mesh.points[:, :2].astype(np.float64))
        settings = PortraitSettings(longest=max(picture.shape))
        mask = portrait_of(photo, settings=settings).mask.vertices
        contours = meshes[1][[*OUTER_LIPS, *INNER_LIPS]]
        curves = find_lips(picture, contours)
        outlines = [
            *((m[list(OUTER_LIPS)], m[list(INNER_LIPS)]) for m in meshes),
            (
                np.concatenate([curves.upper, curves.lower[::-1]]),
                np.concatenate([curves.seam, curves.seam[::-1]]),
            ),
            (mask[MASK_OUTER], mask[MASK_INNER]),
        ]
        for way, (outer, inner) in zip(ways, outlines, strict=True):
            way.outer.append(from_contour(lips[list(OUTER)], outer) / width)
            way.inner.append(from_contour(lips[list(INNER)], inner) / width)
        for eye, marked in zip((LEFT_EYE, RIGHT_EYE), EYES, strict=True):
            points = marks[list(marked)]
            across = float(np.linalg.norm(points[4] - points[0])) / 100
            lids[0].outer.append(from_contour(points, meshes[0][MESH_INDEX[eye]]) / across)
            lids[1].outer.append(from_contour(points, mask[eye]) / across)
    print(f"{len(photos)} people; lips, % of the mouth's width (outer, inner); the bar is 4")
    print("\n".join(map(str, ways)))
    print("lids, % of the eye's width")
    print("\n".join(map(str, lids)))


def write_strips(photos: list[Path], folder: Path) -> None:
    """Each face with its mouths, and with shut eyes."""
    folder.mkdir(parents=True, exist_ok=True)
    for photo in photos:
        content = portrait_of(photo, settings=PortraitSettings(longest=900))
        mask = content.mask
        (x, y), unit = mask.origin, mask.unit
        with PortraitScene(content.photo, mask, content.mouth) as scene:
            pictures = [
                scene.picture(shape + mask.close_lips(), float(jaw))
                for shape, jaw in zip(MOUTH_FRAMES, JAWS, strict=True)
            ]
            pictures += [scene.picture(mask.shut_eyes()), scene.picture(np.zeros((N_MASK, 2)))]
        top, left = max(0, int(y - 0.8 * unit)), max(0, int(x - 0.9 * unit))
        faces = [
            np.asarray(
                cv2.resize(
                    p[top : int(y + 1.4 * unit), left : int(x + 0.9 * unit)],
                    (270, 330),
                    interpolation=cv2.INTER_AREA,
                ),
                dtype=np.uint8,
            )
            for p in pictures
        ]
        faces += [np.zeros_like(faces[0])] * (-len(faces) % 6)
        sheet = cv2.cvtColor(strip(faces, 6), cv2.COLOR_RGB2BGR)
        cv2.imwrite(str(folder / f"{photo.stem}.png"), sheet)


def main() -> None:
    """Compare, and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("portraits", type=Path, nargs="?", default=DEFAULT, metavar="DIR")
    parser.add_argument("--all", action="store_true", help="print the people tuned on, too")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="draw the faces' mouths")
    options = parser.parse_args()
    photos = sorted(options.portraits.rglob("neutral/*.jpg"))
    photos = [p for p in photos if p.with_suffix(".tem").is_file()]
    if len(photos) < EVERY:
        print(f"{options.portraits} holds no marked portraits; name a folder of them")
        return
    cv2.setNumThreads(1)
    held_back = photos[::EVERY]
    print("held back:")
    compare(held_back)
    if options.all:
        print("tuned on:")
        compare([p for p in photos if p not in held_back])
    if options.plots is not None:
        write_strips(held_back, options.plots)


if __name__ == "__main__":
    main()
