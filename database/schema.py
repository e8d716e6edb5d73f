"""Everything that a database holds, field by field, with units.

A database is one HDF5 file. `FIELDS` is the single description of its datasets: the writer
writes what stands here, the reader reads it, CONTRIBUTING and README point here. The
dataclasses below are the same fields in memory, as they go from analysis to the writer and
come back from the reader.

Sizes: N units (frames with a face), S sequences (clips), P phones, K PCA weights, D values
of a normalised crop, C lighting coefficients a channel, h x w the reduced crop. Besides the
datasets, the root carries the attributes of `ATTRIBUTES`.

Every byte that matters has a checksum: each dataset is chunked with fletcher32 (so a single
number is an array of one), strings have a fixed length (HDF5 keeps the others on a heap without
checksums), and the attributes are few and short, so that they stay in the root's object header.
Documents of any length, the three under ``build/``, are datasets for that reason.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from database.lip_model import LEVELS, N_POINTS, LipModel
from database.mask import Camera, Mask
from database.stored_backgrounds import DESCRIBED, GROUP

SCHEMA_NAME: Final = "unitsel-database"
SCHEMA_VERSION: Final = 1

F32 = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Field:
    """One dataset: where it stands, its type and shape, its unit and meaning.

    Parameters
    ----------
    path : str
        Place in the file, ``group/name``.
    dtype : str
        NumPy's name of the type, or ``string``: UTF-8 in fixed length.
    shape : tuple of str or int
        A name stands for a size that is the same wherever the name occurs.
    unit, meaning : str
        For the reader of `field_table`.
    optional : bool
        Whether a database may do without it; a group of optional fields is there as a whole or
        not at all.
    """

    path: str
    dtype: str
    shape: tuple[str | int, ...]
    unit: str
    meaning: str
    optional: bool = False


GUIDES: Final = ("phonemes", "sound")
"""Predictions of the mouth that a database may hold: from the phonemes around a frame, and from
the phonemes and the sound around it."""


def _guide_fields(kind: str) -> tuple[Field, ...]:
    """Fields of one guide; its sizes are its own."""
    e, i, h = f"E {kind}", f"I {kind}", f"H {kind}"
    described = (
        ("columns", "int32", (i,), "index", "inputs that are used (database/guide_model.py)"),
        ("hidden", "float32", (e, i, h), "1", "weights of the hidden layer of each of E networks"),
        ("hidden_bias", "float32", (e, h), "1", "its biases"),
        ("output", "float32", (e, h, "O"), "1", "weights of the output layer"),
        ("output_bias", "float32", (e, "O"), "1", "its biases"),
        ("mean", "float32", ("O",), "parameter's", "added to the scaled outputs"),
        ("scale", "float32", ("O",), "parameter's", "the outputs are multiplied by it"),
        ("gain", "float32", ("O",), "1", "restores the motion that predictions lack"),
        ("skill", "float32", ("O",), "1", "correlation inside speech on clips that were held back"),
    )
    return tuple(
        Field(f"guide_{kind}/{name}", dtype, shape, unit, meaning, optional=True)
        for name, dtype, shape, unit, meaning in described
    )


RIGID_REGIONS: Final = 4
"""Regions of a face's rigid surface; see analysis/photometric.py."""

RIGID_COARSE: Final = 5
"""Of the rigid surface's points every so many have a texture at half the size, too."""


def _rigid_fields() -> tuple[Field, ...]:
    """Fields of what the rigid surface looks like, at full size (R points) and half (Q)."""
    looks = tuple(
        row
        for prefix, n, size in (("", "R", "full"), ("coarse_", "Q", "half"))
        for row in (
            (f"{prefix}values", "float32", ("V", n), "1", f"grey values at {size} size"),
            (f"{prefix}curvature", "float32", ("V", n), "1", "their Laplacian in the picture"),
            (f"{prefix}gradient", "float32", ("V", n, 3), "1/mm", "their gradient, mask frame"),
            (f"{prefix}certainty", "float32", ("V", n), "1", "1 / standard deviation; 0: unseen"),
        )
    )
    described = (
        ("points", "float32", ("R", 3), "mm", "points of the surface, mask frame"),
        ("region", "uint8", ("R",), "index", "region of each (analysis/photometric.py)"),
        ("place", "float32", ("R", 4), "1", "where in its region it lies and how it is turned"),
        ("direction", "float64", ("V", 3), "1", "of each of V views, from the mask's centre"),
        *looks,
    )
    return tuple(
        Field(f"rigid/{name}", dtype, shape, unit, meaning, optional=True)
        for name, dtype, shape, unit, meaning in described
    )


def _lip_fields() -> tuple[Field, ...]:
    """Fields of the lip model and of what it found."""
    both = 2 * N_POINTS
    described: list[tuple[str, str, tuple[str | int, ...], str, str]] = [
        (
            "points",
            "float32",
            ("N", N_POINTS, 2),
            "mm",
            "lips in the mask's frame: 12 outer points, 8 inner, each from the left corner over the "
            "upper lip",
        ),
        (
            "found",
            "uint8",
            ("N",),
            "0, 1",
            "1 where the model found them, 0 where the face mesh's contour stands in",
        ),
        (
            "numbers",
            "float64",
            (3,),
            "1",
            "scale of the finest level, blur of a level, usual squared error (database/lip_model.py)",
        ),
        ("mean_shape", "float32", (N_POINTS, 2), "pixel", "mean of the shapes, finest level"),
        ("shape_modes", "float32", ("shapes", both), "1", "principal components of the shape"),
        ("shape_variances", "float32", ("shapes",), "pixel^2", "variance along each"),
        ("template", "float32", (N_POINTS, 2), "pixel", "shape on which the appearance lies"),
        ("start_bias", "float32", (N_POINTS, 2), "pixel", "added to the face mesh's points"),
        ("start_covariance", "float32", (both, both), "pixel^2", "of what is left"),
    ]
    for i in range(LEVELS):
        h, w, m = (f"level {i} {size}" for size in ("rows", "columns", "modes"))
        described += [
            (f"level{i}/origin", "int32", (2,), "pixel", "first column and row of the box"),
            (f"level{i}/region", "uint8", (h, w), "0, 1", "pixels of the template"),
            (
                f"level{i}/mean",
                "float32",
                (2, h, w),
                "log level",
                "mean brightness and redness, light taken out",
            ),
            (f"level{i}/modes", "float32", (m, 2, h, w), "log level", "principal components"),
            (f"level{i}/variances", "float32", (m,), "1", "variance along each"),
            (f"level{i}/noise", "float32", (2, h, w), "log level^2", "variance left in a pixel"),
        ]
    return tuple(
        Field(f"lips/{name}", dtype, shape, unit, meaning, optional=True)
        for name, dtype, shape, unit, meaning in described
    )


# fmt: off
FIELDS: Final[tuple[Field, ...]] = (
    Field("pictures/data", "uint8", ("N", "padded"), "bytes",
          "each unit's mouth crop as an encoded picture, padded with zeros to one length"),
    Field("pictures/length", "int32", ("N",), "bytes", "true length of each encoded picture"),
    Field("units/sequence", "int32", ("N",), "index", "sequence of the unit"),
    Field("units/frame", "int32", ("N",), "frame",
          "recorded frame number in its sequence, at the database's frame rate (gaps where no "
          "face was seen)"),
    Field("units/phoneme", "uint8", ("N",), "index", "phoneme at the frame's middle (Table 1)"),
    Field("units/viseme", "uint8", ("N",), "index", "viseme of that phoneme (Table 1)"),
    Field("units/pca", "float32", ("N", "K"), "1", "PCA weights of the normalised crop"),
    Field("units/mouth_width", "float32", ("N",), "mm", "width of the outer lip contour"),
    Field("units/mouth_height", "float32", ("N",), "mm",
          "greatest distance from top to bottom of the outer lip contour"),
    Field("units/inner_opening", "float32", ("N",), "mm",
          "greatest distance from top to bottom of the inner lip contour"),
    Field("units/teeth", "float32", ("N",), "0..1", "visibility of the teeth"),
    Field("units/tongue", "float32", ("N",), "0..1", "visibility of the tongue"),
    Field("units/rotation", "float32", ("N", 3), "rad", "head pose: rotation vector"),
    Field("units/translation", "float32", ("N", 3), "mm", "head pose: translation"),
    Field("units/landmarks", "float32", ("N", 468, 2), "pixel",
          "raw face mesh in the recorded picture, nothing smoothed"),
    Field("sequences/name", "string", ("S",), "", "clip name (file name without extension)"),
    Field("sequences/words", "string", ("S",), "", "the words spoken"),
    Field("sequences/media", "string", ("S",), "", "media file the clip was read from"),
    Field("sequences/sha256", "string", ("S",), "", "checksum of that file"),
    Field("sequences/fps", "float32", ("S",), "1/s", "recorded frame rate"),
    Field("sequences/frames", "int32", ("S",), "frames", "frames of the clip, with or without face"),
    Field("sequences/first_unit", "int32", ("S",), "index", "first unit of the sequence"),
    Field("sequences/units", "int32", ("S",), "count", "units of the sequence, one after another"),
    Field("sequences/lighting", "float32", ("S", 3, "C"), "log gain",
          "lighting of the clip against the reference: coefficients a channel (analysis/texture.py)"),
    Field("pieces/start", "float64", ("S",), "s",
          "start of the clip in its media file, where clips are pieces of files", optional=True),
    Field("phones/sequence", "int32", ("P",), "index", "sequence of the phone"),
    Field("phones/phoneme", "uint8", ("P",), "index", "phoneme (Table 1)"),
    Field("phones/start", "float64", ("P",), "s", "start, in the clip's time"),
    Field("phones/end", "float64", ("P",), "s", "end, in the clip's time"),
    Field("marks/phone", "int32", ("M",), "index",
          "phone of each mark: p, b or m whose closure was found, or a silence in which mouth and "
          "voice rest (analysis/phone_marks.py)", optional=True),
    Field("marks/start", "float64", ("M",), "s", "start, in the clip's time", optional=True),
    Field("marks/end", "float64", ("M",), "s", "end, in the clip's time", optional=True),
    Field("marks/sound", "uint8", ("M",), "0 or 1", "whether the sound shows it", optional=True),
    Field("marks/lips", "uint8", ("M",), "0 or 1", "whether the lips show it", optional=True),
    Field("mask/vertices", "float32", (468, 3), "mm", "face mesh of the person, mask frame"),
    Field("mask/grid", "float32", ("rows", "columns", 3), "mm",
          "surface around the mouth, mask frame (database/mask.py)"),
    Field("mask/crop_size", "int32", (2,), "pixel", "width and height of a crop"),
    Field("camera", "float64", (5,), "pixel", "focal length, cx, cy, width, height"),
    Field("texture/mean", "float32", ("D",), "level", "mean normalised crop, windowed"),
    Field("texture/components", "float32", ("K", "D"), "1", "principal components, unit length"),
    Field("texture/eigenvalues", "float32", ("K",), "level^2", "variance along each component"),
    Field("texture/window", "float32", ("h", "w"), "1", "weight of each pixel of the reduced crop"),
    Field("texture/reference", "float32", ("h", "w", 3), "log level",
          "reference lighting of the reduced crop"),
    Field("costs/phoneme_distance", "float32", (43, 43), "1",
          "M, equation 5; rows of phonemes that the corpus lacks are filled in"),
    Field("costs/target_scale", "float64", (1,), "1",
          "median target cost over random pairs of frames; target costs are divided by it"),
    Field("costs/feature_scales", "float64", (4,), "1",
          "root mean square distance of random pairs: PCA, lips, teeth, tongue"),
    Field("costs/visual_scale", "float64", (1,), "1",
          "median of f over random pairs inside a viseme; visual costs are divided by it"),
    Field("build/settings", "string", (1,), "", "build settings, JSON"),
    Field("build/versions", "string", (1,), "",
          "versions of unitsel and of the libraries that shaped the content, JSON"),
    Field("build/report", "string", (1,), "", "what the build skipped or repaired, JSON"),
    Field("consent/note", "string", (1,), "",
          "what the person filmed has agreed to, as whoever built the database wrote it",
          optional=True),
    Field("selection/settings", "string", (1,), "",
          "settings of the selection that this database asks for, JSON", optional=True),
    Field("sound/features", "float16", ("F", 26), "1",
          "mel spectrum of all clips that have sound (database/sound_features.py), one after "
          "another, in the time of their phones", optional=True),
    Field("sound/steps", "int32", ("S",), "count",
          "steps of each sequence's sound, 100 a second; 0 without sound", optional=True),
    *(f for kind in GUIDES for f in _guide_fields(kind)),
    *_rigid_fields(),
    *_lip_fields(),
    *(Field(f"{GROUP}/{n}", t, s, u, m, optional=True) for n, t, s, u, m in DESCRIBED),
)
# fmt: on
"""All datasets."""

ATTRIBUTES: Final[dict[str, str]] = {
    "schema": "always 'unitsel-database'",
    "schema_version": "version of this description; files of another version are refused",
    "fps": "frame rate of the database, 1/s; selection runs at it",
    "codec": "codec of the pictures, NAME or NAME:QUALITY (database/pictures.py)",
    "created": "UTC time of the build; not part of the content",
    "host": "machine of the build; not part of the content",
    "jobs": "parallel jobs of the build; not part of the content",
}

UNHASHED_ATTRIBUTES: Final = frozenset({"created", "host", "jobs"})
"""Attributes that may differ between databases that count as identical."""


def field_table() -> str:
    """All fields and attributes as a table in Markdown, for the documentation.

    Returns
    -------
    str
        Lines without a newline at the end.
    """
    lines = ["| dataset | type | shape | unit | meaning |", "| --- | --- | --- | --- | --- |"]
    for f in FIELDS:
        shape = " x ".join(str(size) for size in f.shape)
        lines.append(f"| `{f.path}` | {f.dtype} | {shape} | {f.unit} | {f.meaning} |")
    lines += ["", "| attribute of the root | meaning |", "| --- | --- |"]
    lines += [f"| `{name}` | {meaning} |" for name, meaning in ATTRIBUTES.items()]
    return "\n".join(lines)


@dataclass(frozen=True)
class Units:
    """Parameters of the N units; see `FIELDS` for shapes and units."""

    sequence: npt.NDArray[np.int32]
    frame: npt.NDArray[np.int32]
    phoneme: npt.NDArray[np.uint8]
    viseme: npt.NDArray[np.uint8]
    pca: F32
    mouth_width: F32
    mouth_height: F32
    inner_opening: F32
    teeth: F32
    tongue: F32
    rotation: F32
    translation: F32

    def __len__(self) -> int:
        return len(self.sequence)


@dataclass(frozen=True)
class Sequences:
    """The S clips; see `FIELDS` for shapes and units."""

    name: tuple[str, ...]
    words: tuple[str, ...]
    media: tuple[str, ...]
    sha256: tuple[str, ...]
    fps: F32
    frames: npt.NDArray[np.int32]
    first_unit: npt.NDArray[np.int32]
    units: npt.NDArray[np.int32]
    lighting: F32

    def __len__(self) -> int:
        return len(self.name)


@dataclass(frozen=True)
class Phones:
    """The P phones of all sequences, at time resolution; see `FIELDS`."""

    sequence: npt.NDArray[np.int32]
    phoneme: npt.NDArray[np.uint8]
    start: npt.NDArray[np.float64]
    end: npt.NDArray[np.float64]


@dataclass(frozen=True)
class PhoneMarks:
    """The M closures and rests found in sound and lips, at time resolution; see `FIELDS`."""

    phone: npt.NDArray[np.int32]
    start: npt.NDArray[np.float64]
    end: npt.NDArray[np.float64]
    sound: npt.NDArray[np.uint8]
    lips: npt.NDArray[np.uint8]

    @classmethod
    def none(cls) -> PhoneMarks:
        """No marks."""
        nowhere = np.zeros(0)
        nothing = np.zeros(0, np.uint8)
        return cls(np.zeros(0, np.int32), nowhere, nowhere, nothing, nothing)

    def __len__(self) -> int:
        return len(self.phone)


@dataclass(frozen=True)
class TextureModel:
    """PCA of the normalised crops and the lighting they are normalised to; see `FIELDS`."""

    mean: F32
    components: F32
    eigenvalues: F32
    window: F32
    reference: F32


@dataclass(frozen=True)
class CostModel:
    """What the costs need of the corpus as a whole; see `FIELDS`."""

    phoneme_distance: F32
    target_scale: float
    feature_scales: npt.NDArray[np.float64]
    visual_scale: float


@dataclass(frozen=True)
class GuideModel:
    """A small ensemble of networks that predicts a mouth; see `FIELDS` and `guide_model`."""

    columns: npt.NDArray[np.int32]
    hidden: F32
    hidden_bias: F32
    output: F32
    output_bias: F32
    mean: F32
    scale: F32
    gain: F32
    skill: F32


@dataclass(frozen=True)
class RigidTexture:
    """What the person's rigid surface looks like: where the mask sits on a face; see `FIELDS`."""

    points: F32
    region: npt.NDArray[np.uint8]
    place: F32
    direction: npt.NDArray[np.float64]
    values: F32
    curvature: F32
    gradient: F32
    certainty: F32
    coarse_values: F32
    coarse_curvature: F32
    coarse_gradient: F32
    coarse_certainty: F32


@dataclass(frozen=True)
class UnitLips:
    """The lip model and what it found in each unit; see `FIELDS`."""

    model: LipModel
    points: F32
    found: npt.NDArray[np.uint8]


@dataclass(frozen=True)
class DatabaseContent:
    """All of a database but its pictures and landmarks, which come unit by unit."""

    fps: float
    units: Units
    sequences: Sequences
    phones: Phones
    mask: Mask
    camera: Camera
    texture: TextureModel
    costs: CostModel
    marks: PhoneMarks = field(default_factory=PhoneMarks.none)
    sound: tuple[npt.NDArray[np.float16], ...] = ()
    guides: dict[str, GuideModel] = field(default_factory=dict)
    rigid: RigidTexture | None = None
    lips: UnitLips | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    report: dict[str, Any] = field(default_factory=dict)
    consent: str = ""
    starts: npt.NDArray[np.float64] | None = None
