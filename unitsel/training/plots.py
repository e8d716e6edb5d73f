"""Plots of a training: the paper's Figures 9, 10 and 11."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from unitsel.plots import COLOURS, new_figure, plots_folder, saved_plot
from unitsel.training.pareto import non_dominated
from unitsel.training.result import Motion, Training, Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = npt.NDArray[np.float64]

LABELS: Final = {
    "tc_avg": "average target cost",
    "sl_avg": "average segment length (frames)",
    "vc_avg": "average visual distance",
}
GREY: Final = COLOURS["phoneme_mean"]
R_COLOURS: Final = {"r_pca_speech": COLOURS["real"], "r_h_speech": COLOURS["selected"]}
R_LABELS: Final = {"r_pca_speech": "r_pca, first PCA weight", "r_h_speech": "r_h, mouth height"}

LABELLED: Final = 5
"""Points of the front whose correlations are written beside them."""

NEIGHBOURS: Final = 0.1
"""Share of the front that a point of a smoothed line is the mean of."""


def plot_training(training: Training, folder: str | Path) -> list[Path]:
    """Draw the front, the correlations along it, and a sentence with the chosen weights.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    UnitselError
        If the folder cannot be made or a file cannot be written.
    """
    out = plots_folder(folder)
    return [
        _front(training, out / "front.png"),
        _correlations(training, out / "correlations.png"),
        _motion(training.example, out / "trajectories.png"),
    ]


def _front(training: Training, path: Path) -> Path:
    """Figure 9: the sets tried (grey) and the front, in each pair of objectives.

    The line joins those of the front that are best in the two alone.
    """
    figure = new_figure(15, 5)
    axes = figure.subplots(1, 3)
    pairs = (("sl_avg", "tc_avg"), ("vc_avg", "tc_avg"), ("vc_avg", "sl_avg"))
    likeness = np.array([t.measures.likeness for t in training.front])
    for axis, (x, y) in zip(axes, pairs, strict=True):
        axis.plot(*_values(training.trials, x, y), ".", ms=4, mew=0, color=GREY, alpha=0.35)
        axis.plot(*_values(_edge(training.front, x, y), x, y), color="#555555", linewidth=0.9)
        points = _values(training.front, x, y)
        shown = axis.scatter(*points, s=16, c=likeness, cmap="viridis", zorder=3)
        _mark(axis, training.default, x, y, "s", GREY, "default weights")
        _mark(axis, training.chosen, x, y, "*", COLOURS["real"], "chosen")
        axis.set_xlabel(LABELS[x])
        axis.set_ylabel(LABELS[y])
        axis.grid(alpha=0.25)
        _limit(axis, training, x, y)
    for i, trial in enumerate(_along(training.front)):
        m = trial.measures
        last = i == LABELLED - 1
        axes[1].annotate(
            f"({m.r_pca_speech:.2f}, {m.r_h_speech:.2f})",
            (m.vc_avg, m.tc_avg),
            xytext=(0, -15) if last else (6, 10),
            textcoords="offset points",
            ha="right" if last else "left",
            fontsize=8,
        )
    axes[0].legend(fontsize=8)
    figure.colorbar(shown, ax=axes, label="mean of r_pca and r_h", pad=0.01)
    figure.suptitle(
        f"{len(training.trials)} sets of weights on {len(training.sentences)} sentences, "
        f"{len(training.front)} of them on the front; beside some: (r_pca, r_h)",
        fontsize=10,
    )
    return saved_plot(figure, path)


def _correlations(training: Training, path: Path) -> Path:
    """Figure 10: likeness to the recordings along the front, by the visual distance."""
    front = sorted(training.front, key=lambda t: t.measures.vc_avg)
    distance = np.array([t.measures.vc_avg for t in front])
    figure = new_figure(8, 4.5)
    axis = figure.subplots()
    for name, colour in R_COLOURS.items():
        r = np.array([getattr(t.measures, name) for t in front])
        axis.scatter(distance, r, s=9, color=colour, alpha=0.35, linewidths=0)
        axis.plot(distance, _smoothed(r), color=colour, linewidth=1.6, label=R_LABELS[name])
    chosen, most_alike = training.chosen.measures, training.most_alike.measures
    axis.axvline(chosen.vc_avg, color="#333333", linewidth=0.9, linestyle=":")
    for name, colour in R_COLOURS.items():
        axis.plot(most_alike.vc_avg, getattr(most_alike, name), "o", ms=8, mfc="none", mec=colour)
    for name, colour in R_COLOURS.items():
        axis.plot(chosen.vc_avg, getattr(chosen, name), "*", color=colour, markersize=13)
    axis.set_title(
        f"chosen: r_pca {chosen.r_pca_speech:.2f}, r_h {chosen.r_h_speech:.2f}; "
        "circles: the greatest likeness; lines: means of neighbours",
        fontsize=9,
    )
    axis.set_xlabel(LABELS["vc_avg"])
    axis.set_ylabel("correlation inside speech")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.25)
    return saved_plot(figure, path)


def _motion(motion: Motion, path: Path) -> Path:
    """Figure 11: a sentence as recorded and as selected."""
    figure = new_figure(9, 5)
    upper, lower = figure.subplots(2, 1, sharex=True)
    rows = (
        (upper, motion.real_pca, motion.made_pca, "first PCA weight"),
        (lower, motion.real_height, motion.made_height, "mouth height (mm)"),
    )
    for axis, real, made, label in rows:
        axis.axvspan(*motion.speech, color="#f2f2f2", zorder=0)
        axis.plot(motion.seconds, real, color=COLOURS["real"], linewidth=1.6, label="real")
        axis.plot(motion.seconds, made, color=COLOURS["selected"], linewidth=1.6, label="animated")
        axis.set_ylabel(label)
        axis.grid(alpha=0.25)
    upper.set_title(
        f"{motion.clip}: {motion.words}    inside speech (grey) r_pca {motion.r_pca:.2f}, "
        f"r_h {motion.r_h:.2f}",
        fontsize=9,
    )
    upper.legend(loc="upper right", fontsize=8)
    lower.set_xlabel("seconds")
    return saved_plot(figure, path)


def _values(trials: tuple[Trial, ...], x: str, y: str) -> tuple[FloatArray, FloatArray]:
    return (
        np.array([getattr(t.measures, x) for t in trials], dtype=np.float64),
        np.array([getattr(t.measures, y) for t in trials], dtype=np.float64),
    )


def _edge(front: tuple[Trial, ...], x: str, y: str) -> tuple[Trial, ...]:
    """The sets of the front that no other beats in two of the objectives alone, by the first."""
    signs = [-1.0 if name == "sl_avg" else 1.0 for name in (x, y)]
    both = np.column_stack(_values(front, x, y)) * signs
    best = [front[i] for i in non_dominated(both)]
    return tuple(sorted(best, key=lambda t: (getattr(t.measures, x), getattr(t.measures, y))))


def _mark(axis: Axes, trial: Trial, x: str, y: str, marker: str, colour: str, label: str) -> None:
    axis.plot(
        getattr(trial.measures, x),
        getattr(trial.measures, y),
        marker,
        color=colour,
        markersize=15 if marker == "*" else 8,
        markeredgecolor="black",
        markeredgewidth=0.7,
        linestyle="none",
        label=label,
        zorder=4,
    )


def _limit(axis: Axes, training: Training, x: str, y: str) -> None:
    """Show the front and a little around it: sets far off it would press it into a corner."""
    for name, limit in ((x, axis.set_xlim), (y, axis.set_ylim)):
        shown = [getattr(t.measures, name) for t in (*training.front, training.default)]
        low, high = min(shown), max(shown)
        if high > low:
            limit(low - 0.08 * (high - low), high + 0.12 * (high - low))


def _along(front: tuple[Trial, ...]) -> list[Trial]:
    """A few sets along the front, evenly by their visual distance."""
    by_distance = sorted(front, key=lambda t: t.measures.vc_avg)
    distances = np.array([t.measures.vc_avg for t in by_distance])
    wanted = np.linspace(distances[0], distances[-1], LABELLED)
    places = dict.fromkeys(int(np.abs(distances - w).argmin()) for w in wanted)
    return [by_distance[i] for i in places]


def _smoothed(values: FloatArray) -> FloatArray:
    """Mean of each value's neighbours; fewer at the ends, as many on both sides."""
    reach = max(1, round(NEIGHBOURS * len(values) / 2))
    out = np.empty(len(values))
    for i in range(len(values)):
        near = min(reach, i, len(values) - 1 - i)
        out[i] = values[i - near : i + near + 1].mean()
    return out
