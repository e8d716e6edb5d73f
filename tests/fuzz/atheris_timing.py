"""Coverage-guided fuzzing of the timing readers with Atheris, by hand and for as long as one likes.

Atheris is no dependency. In an environment of its own, from the repository's root::

    python -m venv /tmp/fuzz && /tmp/fuzz/bin/pip install atheris numpy
    PYTHONPATH=. /tmp/fuzz/bin/python tests/fuzz/atheris_timing.py -max_total_time=600 /tmp/seeds

The folder gets the valid files of tests/data/timing and what is found on the way; options with one
dash are libFuzzer's. The property is the one of tests/test_timing_fuzz.py.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from timing_property import check_tagged, seed_files

__all__ = ["check_tagged", "main", "write_seeds"]


def write_seeds(folder: Path) -> list[Path]:
    """Write the seed corpus."""
    folder.mkdir(parents=True, exist_ok=True)
    out = []
    for name, data in seed_files().items():
        out.append(folder / name)
        out[-1].write_bytes(data)
    return out


def main(arguments: Sequence[str]) -> str | None:
    """Fuzz until told to stop; gives what is wrong, if the fuzzer cannot be started."""
    folders = [a for a in arguments[1:] if not a.startswith("-")]
    if not folders:
        return "name a folder for the corpus: atheris_timing.py [-max_total_time=600] FOLDER"
    try:
        import atheris
    except ImportError:
        return "needs Atheris: pip install atheris, in an environment of its own"
    write_seeds(Path(folders[0]))
    atheris.instrument_all()
    atheris.Setup(list(arguments), check_tagged)
    atheris.Fuzz()
    return None


if __name__ == "__main__":
    sys.exit(main(sys.argv))
