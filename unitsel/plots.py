"""Pictures of databases and evaluations, written as PNG files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from database.errors import UnitselError
from database.phonemes import VISEMES
from database.reader import UnitDatabase
from unitsel.inspection import extreme_units, typical_units
from unitsel.likeness.evaluation import Evaluation, Sentence

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {"real": "#c0392b", "selected": "#2458a6", "phoneme_mean": "#9aa0a6"}


def plots_folder(folder: str | Path) -> Path:
    """The folder, made if only it is missing.

    Raises
    ------
    UnitselError
        If it cannot be made.
    """
    path = Path(folder)
    if path.exists() and not path.is_dir():
        raise UnitselError(f"{path}: is a file; name a folder for the plots")
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise UnitselError(f"{path}: cannot be made ({error.strerror}); make it first") from error
    return path


def plot_database(database: UnitDatabase, folder: str | Path) -> list[Path]:
    """Draw typical and extreme mouths and the share of each viseme.

    Returns
    -------
    list of Path
        The files written.
    """
    out = plots_folder(folder)
    typical = typical_units(database)
    extremes = extreme_units(database)
    return [
        _sheet(
            database,
            list(typical.values()),
            [f"{v}: {' '.join(VISEMES[v])}" for v in typical],
            out / "typical-mouths.png",
        ),
        _sheet(database, list(extremes.values()), list(extremes), out / "extreme-mouths.png"),
        _shares(database, out / "visemes.png"),
    ]


def plot_evaluation(evaluation: Evaluation, folder: str | Path) -> list[Path]:
    """Draw the trajectories of every sentence, as in the paper's Figure 11."""
    out = plots_folder(folder)
    return [_trajectories(s, out / f"{s.clip.replace('/', '-')}.png") for s in evaluation.sentences]


def strip(pictures: Sequence[npt.NDArray[np.uint8]], columns: int) -> npt.NDArray[np.uint8]:
    """Pictures of one size side by side, row after row; the last row is filled with black."""
    rows = -(-len(pictures) // columns)
    filled = [*pictures, *[np.zeros_like(pictures[0])] * (rows * columns - len(pictures))]
    return np.concatenate(
        [np.concatenate(filled[r * columns : (r + 1) * columns], axis=1) for r in range(rows)]
    )


def _sheet(database: UnitDatabase, units: list[int], titles: list[str], path: Path) -> Path:
    columns = 7
    rows = -(-len(units) // columns)
    figure = new_figure(1.7 * columns, 2.0 * rows)
    axes = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, unit, title in zip(axes, units, titles, strict=False):
        axis.imshow(database.picture(unit))
        axis.set_title(title, fontsize=8)
    return saved_plot(figure, path)


def _shares(database: UnitDatabase, path: Path) -> Path:
    counts = np.bincount(database.units.viseme, minlength=len(VISEMES))
    figure = new_figure(9, 3.2)
    axis = figure.subplots()
    axis.bar(range(len(VISEMES)), counts, color=COLOURS["selected"])
    axis.set_xticks(range(len(VISEMES)), [" ".join(v) for v in VISEMES], rotation=60, fontsize=7)
    axis.set_yscale("symlog", linthresh=10)
    axis.set_ylabel("units")
    return saved_plot(figure, path)


def _trajectories(sentence: Sentence, path: Path) -> Path:
    figure = new_figure(9, 5)
    upper, lower = figure.subplots(2, 1, sharex=True)
    score = sentence.scores["selected"]
    _draw(upper, sentence, "pca", "first PCA weight")
    upper.set_title(
        f"{sentence.clip}: {sentence.words}    inside speech r_pca {score.r_pca_speech:.2f}, "
        f"r_h {score.r_h_speech:.2f}",
        fontsize=9,
    )
    _draw(lower, sentence, "height", "mouth height (mm)")
    lower.set_xlabel("seconds")
    upper.legend(loc="upper right", fontsize=8)
    return saved_plot(figure, path)


def _draw(axis: Axes, sentence: Sentence, parameter: str, label: str) -> None:
    lines = {"real": sentence.real, **{m: sentence.made[m] for m in ("selected", "phoneme_mean")}}
    for name, trajectory in lines.items():
        axis.plot(
            sentence.seconds,
            getattr(trajectory, parameter),
            color=COLOURS[name],
            label=name.replace("_", " "),
            linewidth=1.6 if name != "phoneme_mean" else 1.0,
        )
    axis.set_ylabel(label)
    axis.grid(alpha=0.25)


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches; matplotlib takes a second to load, so only who draws loads it."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def saved_plot(figure: Figure, path: Path) -> Path:
    """Write a figure to a file and give its path back.

    Raises
    ------
    UnitselError
        If it cannot be written.
    """
    try:
        figure.savefig(path, dpi=110)
    except OSError as error:
        raise UnitselError(f"{path}: cannot be written ({error.strerror})") from error
    return path
