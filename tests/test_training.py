"""Training on the puppet: what is tried, what is kept, and that nothing but the seed decides."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from analysis.corpus import find_clips
from analysis.face import FaceModels
from database.cost_definition import CostSettings, FeatureWeights
from database.errors import CorpusError, DatabaseError, SelectionError
from database.fingerprint import identity
from database.reader import UnitDatabase, open_database
from database.timing import Timing, write_timing
from database.track import context_windows
from unitsel.costs import Weights
from unitsel.likeness.evaluation import Evaluator
from unitsel.likeness.measures import sl_avg
from unitsel.lip_targets import lip_costs, wanted_phonemes
from unitsel.select import select_units
from unitsel.settings import SelectionSettings, TargetSettings, settings_for
from unitsel.source import SelectionInput
from unitsel.training.pareto import ParetoSettings, non_dominated
from unitsel.training.plots import plot_training
from unitsel.training.rehearsal import Player, Rehearsal, TrainingSentence, TrialMeasures
from unitsel.training.result import Training, TrainingSettings, Trial, smoothest_of_the_best
from unitsel.training.train import train
from unitsel.training.trials import TrialFile, Trials

PAPER = TargetSettings("paper")
BASE = settings_for("paper")
QUICK = TrainingSettings(PAPER, pareto=ParetoSettings(population=12, generations=3))


@pytest.fixture(scope="module")
def database(puppet_db: Path) -> Iterator[UnitDatabase]:
    """Open the puppet's database."""
    with open_database(puppet_db) as opened:
        yield opened


@pytest.fixture(scope="module")
def unseen(
    puppet: ModuleType, puppet_corpus: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Film two clips that the database lacks; beside them one that it holds and one unworded."""
    folder = tmp_path_factory.mktemp("training")
    for seed, (name, said) in enumerate(
        {"a1": "bin green at m five now", "c3": "lay white with x two"}.items(), 40
    ):
        track, words = puppet.even_track(said, 0.2, 1.2)
        puppet.write_clip(folder / f"{name}.mp4", track, puppet.hum(track), seed)
        write_timing(folder / f"{name}.TextGrid", Timing(track, words))
    for extension in ("mp4", "TextGrid"):
        source = puppet_corpus / f"hopper2.{extension}"
        (folder / f"b2.{extension}").write_bytes(source.read_bytes())
    (folder / "d4.mp4").write_bytes((folder / "c3.mp4").read_bytes())
    return folder


@pytest.fixture(scope="module")
def sentences(
    database: UnitDatabase, unseen: Path, face_models: FaceModels
) -> tuple[TrainingSentence, ...]:
    """The two clips, analysed."""
    evaluator = Evaluator(database)
    targets = [evaluator.target(c) for c in find_clips(unseen) if c.name in ("a1", "c3")]
    return tuple(
        TrainingSentence(
            *(t.clip, t.words, t.track, np.asarray(t.frames)),
            *(t.pca[:, 0].astype(float), t.height.astype(float)),
        )
        for t in targets
    )


@pytest.fixture
def player(database: UnitDatabase, sentences: tuple[TrainingSentence, ...]) -> Player:
    return Player(database, Rehearsal(database.path, sentences, BASE))


@pytest.fixture(scope="module")
def found(database: UnitDatabase, unseen: Path, face_models: FaceModels) -> Training:
    return train(database, unseen, QUICK)


def to_weights(numbers: tuple[float, ...]) -> SelectionSettings:
    return replace(BASE, weights=Weights(1, 1, *numbers))


# What a set measures


def test_measures_are_those_of_the_selection(
    database: UnitDatabase, sentences: tuple[TrainingSentence, ...], player: Player
) -> None:
    settings = replace(BASE, weights=Weights(skip=0.3))
    measures = player.measure(settings)
    units = database.units
    lengths, costs, heights, first = [], [], [], []
    for s in sentences:
        selection = select_units(SelectionInput.of(database), s.track, settings)
        path = selection.units
        lengths.append(sl_avg(units.sequence[path], units.frame[path]))
        costs.append(selection.costs.target.mean())
        start, end = s.track.speech_span()
        times = (s.frames + 0.5) / database.fps
        inside = (times >= start) & (times < end)
        shown = path[s.frames]
        heights.append(np.corrcoef(units.mouth_height[shown][inside], s.height[inside])[0, 1])
        first.append(np.corrcoef(units.pca[shown, 0][inside], s.pca[inside])[0, 1])
    assert measures.sl_avg == pytest.approx(np.mean(lengths))
    assert measures.tc_avg == pytest.approx(np.mean(costs))
    assert measures.r_h_speech == pytest.approx(np.mean(heights), abs=1e-6)
    assert measures.r_pca_speech == pytest.approx(np.mean(first), abs=1e-6)
    assert measures.objectives == (measures.tc_avg, -measures.sl_avg, measures.vc_avg)
    assert measures.likeness == pytest.approx((np.mean(first) + np.mean(heights)) / 2, abs=1e-6)


def test_target_costs_of_other_constants_are_counted_by_the_same_ruler(
    database: UnitDatabase, sentences: tuple[TrainingSentence, ...], player: Player
) -> None:
    """A shorter context would make every target cost smaller, and no mouth better."""
    costs = CostSettings(beta1=-1.0, context=0.04, features=FeatureWeights(1, 0.5, 2, 0.25))
    settings = replace(BASE, costs=costs)
    measured = player.measure(settings).tc_avg
    source = SelectionInput.of(database)
    expected = []
    for i, s in enumerate(sentences):
        units = player.select(settings, i).units
        assert (
            units == select_units(SelectionInput.of(database, costs), s.track, settings).units
        ).all()
        wanted = context_windows(wanted_phonemes(s.track, database.fps, BASE.lips), 5)
        m = source.phoneme_distance[wanted, source.contexts[units]] @ source.context_weights
        own = [units[t : t + 1] for t in range(len(units))]
        held = lip_costs(source.lips, s.track, database.fps, own, BASE.lips)
        assert held is not None and any(cost is not None for cost in held)
        lips = np.array([0.0 if cost is None else cost[0] for cost in held])
        expected.append((m / source.target_scale + lips).mean())
    assert measured == pytest.approx(np.mean(expected))


def test_a_player_forgets_all_but_the_base_and_the_last_constants(player: Player) -> None:
    first = player.measure(BASE)
    for beta1 in (-0.1, -0.2, -0.4):
        player.measure(replace(BASE, costs=CostSettings(beta1=beta1)))
    assert len(player._prepared) == 2
    assert player.measure(BASE) == first


# Trials


def test_each_set_is_tried_once_and_noted(player: Player, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    with TrialFile(tmp_path / "state", {"seed": 1}) as file:
        trials = Trials(player, to_weights, file=file, progress=lambda *p: told.append(p))
        objectives = trials.objectives(np.array([[0.1, 0.2], [0.3, 0.4], [0.1, 0.2]]))
        assert trials.tried == 2
        assert (objectives[0] == objectives[2]).all() and (objectives[0] != objectives[1]).any()
        trials.measure([(0.3, 0.4), (0.5, 0.6)])
        assert trials.tried == 3
    assert told == [(0, 2), (1, 2), (2, 2), (2, 3), (3, 3)]
    assert list(trials.asked) == [(0.1, 0.2), (0.3, 0.4), (0.5, 0.6)]
    assert trials.asked[0.5, 0.6] == player.measure(to_weights((0.5, 0.6)))
    with TrialFile(tmp_path / "state", {"seed": 1}, resume=True) as file:
        assert file.known == trials.asked


def test_workers_find_what_one_process_finds(player: Player) -> None:
    sets = [(0.01, 0.1), (0.1, 0.1), (0.2, 0.05), (0.0, 0.3), (0.4, 0.0)]
    alone, together = Trials(player, to_weights), Trials(player, to_weights, jobs=2)
    alone.measure(sets)
    together.measure(sets)
    assert list(together.asked.items()) == list(alone.asked.items())


def test_an_error_in_a_worker_is_told(player: Player) -> None:
    lacking = replace(player.rehearsal, base=replace(BASE, target=TargetSettings("guided")))
    trials = Trials(Player(player.database, lacking), lambda _: lacking.base, jobs=2)
    with pytest.raises(SelectionError, match="guide"):
        trials.measure([(0.0, 1.0), (0.0, 2.0)])


# Training


def test_the_front_is_what_nobody_beats_and_the_chosen_is_its_best(found: Training) -> None:
    objectives = np.array([t.measures.objectives for t in found.trials])
    front = {found.trials[i].settings.weights for i in non_dominated(objectives)}
    assert {t.settings.weights for t in found.front} == front
    assert found.chosen in found.front
    assert found.most_alike.measures.likeness == max(t.measures.likeness for t in found.front)
    assert (found.chosen, found.most_alike) == smoothest_of_the_best(found.front)
    costs = [t.measures.tc_avg for t in found.front]
    assert costs == sorted(costs)
    # Weights do decide something here.
    assert found.front[-1].measures.tc_avg > 1.2 * found.front[0].measures.tc_avg
    lengths = [t.measures.sl_avg for t in found.front]
    assert max(lengths) > 1.2 * min(lengths)


def test_of_equally_good_sets_the_smoothest_is_taken() -> None:
    def trial(vc: float, *likeness: float) -> Trial:
        mean = float(np.mean(likeness))
        return Trial(BASE, TrialMeasures(0.1, 2.0, vc, mean, mean, 1.0, likeness))

    best = trial(9, 0.80, 0.70, 0.90, 0.84)
    # Worse by 0.01 in the mean with a standard error of 0.0041, then of 0.0122.
    worse = trial(3, 0.80, 0.69, 0.89, 0.82)
    equal = trial(5, 0.82, 0.70, 0.86, 0.82)
    assert smoothest_of_the_best([worse, best, equal]) == (equal, best)
    assert smoothest_of_the_best([worse, best]) == (best, best)
    # One sentence says nothing of chance.
    assert smoothest_of_the_best([trial(1, 0.8), trial(2, 0.9)])[0].measures.vc_avg == 2


def test_training_tries_the_grid_and_the_default(found: Training) -> None:
    weights = {t.settings.weights for t in found.trials}
    assert BASE.weights in weights
    assert found.default.settings == BASE
    assert len(weights) == len(found.trials) == found.tried
    assert 442 < len(found.trials) <= 443 + 3 * 12
    assert found.evolution.generations == 3


def test_clips_of_the_database_and_useless_ones_are_skipped_by_name(found: Training) -> None:
    assert [clip for clip, _ in found.sentences] == ["a1", "c3"]
    (known, why), (unworded, reason) = found.skipped
    assert known == "b2" and "is part of the database" in why and "--exclude b2" in why
    assert unworded == "d4" and "d4.txt" in reason


def test_a_second_run_and_a_resumed_one_give_the_same_file(
    found: Training, database: UnitDatabase, unseen: Path, tmp_path: Path
) -> None:
    state = tmp_path / "state"
    first = train(database, unseen, QUICK, state=state)
    whole = state.read_bytes()
    lines = whole.splitlines(keepends=True)
    assert len(lines) == 1 + len(first.trials)
    # As a kill in the middle of a generation leaves it.
    state.write_bytes(b"".join(lines[:460])[:-30])
    resumed = train(database, unseen, QUICK, state=state, resume=True)
    assert resumed.tried == len(lines) - 459
    assert state.read_bytes() == whole
    for i, training in enumerate((found, first, resumed)):
        training.write(tmp_path / f"{i}.json")
        assert (tmp_path / f"{i}.json").read_bytes() == (tmp_path / "0.json").read_bytes()
    assert resumed.front == found.front


def test_another_seed_looks_elsewhere(
    found: Training, database: UnitDatabase, unseen: Path
) -> None:
    other = train(database, unseen, replace(QUICK, pareto=replace(QUICK.pareto, seed=1)))
    assert other.trials[:443] == found.trials[:443]
    assert other.trials[443:] != found.trials[443:]


def test_the_file_says_where_the_weights_come_from(
    found: Training, database: UnitDatabase, tmp_path: Path
) -> None:
    path = tmp_path / "weights.json"
    found.write(path)
    read = SelectionSettings.read(path, database=identity(database))
    assert read == found.chosen.settings
    with pytest.raises(SelectionError, match="trained on another database"):
        SelectionSettings.read(path, database="another")
    about = json.loads(path.read_text())["about"]
    assert about["front_size"] == len(found.front)
    assert len(about["front"]) == min(100, len(found.front))
    assert about["chosen"] == found.chosen.as_json()
    assert [s["clip"] for s in about["sentences"]] == ["a1", "c3"]
    assert about["settings"]["seed"] == 0 and about["sets"] == len(found.trials)
    assert set(about["versions"]) == {"unitsel", "numpy", "numba", "pymoo"}
    assert json.loads(json.dumps(found.as_json(), allow_nan=False)) == found.as_json()


def test_features_are_trained_by_option(
    database: UnitDatabase, unseen: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Every set prepares the database anew: a few will do here.
    monkeypatch.setattr("unitsel.training.weight_space.SETTINGS_PER_WEIGHT", 2)
    monkeypatch.setattr("unitsel.training.weight_space.SPREAD", 20)
    settings = replace(QUICK, features=True)
    found = train(database, unseen, settings)
    assert found.front == train(database, unseen, settings).front
    costs = {t.settings.costs for t in found.trials}
    assert len(costs) > 30
    for name in ("beta1", "context"):
        assert len({getattr(c, name) for c in costs}) > 5
    assert {"features", "beta1", "context"} <= set(found.about()["chosen"])
    assert 24 <= len(found.trials) <= 70


def test_a_sentence_of_median_likeness_is_shown(found: Training, database: UnitDatabase) -> None:
    example = found.example
    assert example.clip in ("a1", "c3")
    n = len(example.seconds)
    for values in (example.real_pca, example.real_height, example.made_pca, example.made_height):
        assert values.shape == (n,)
    inside = (example.seconds >= example.speech[0]) & (example.seconds < example.speech[1])
    r = np.corrcoef(example.real_height[inside], example.made_height[inside])[0, 1]
    assert example.r_h == pytest.approx(r, abs=1e-6)


def test_plots_are_drawn(found: Training, tmp_path: Path) -> None:
    paths = plot_training(found, tmp_path / "plots")
    assert [p.name for p in paths] == ["front.png", "correlations.png", "trajectories.png"]
    for path in paths:
        picture = cv2.imread(str(path))
        assert picture is not None and picture.shape[1] > 800 and picture.std() > 10


def test_plots_of_a_front_of_one(found: Training, tmp_path: Path) -> None:
    one = found.chosen
    lonely = replace(found, front=(one,), trials=(one,), default=one, most_alike=one)
    assert all(p.is_file() for p in plot_training(lonely, tmp_path / "plots"))


# What cannot be trained with

Folder = Callable[[Path], object]


def _nothing(folder: Path) -> None:
    (folder / "notes.md").write_text("no clip")


def _junk(folder: Path) -> None:
    (folder / "x.mp4").write_bytes(b"no video")
    (folder / "x.txt").write_text("bin blue now")


@pytest.mark.parametrize(
    ("fill", "words"),
    [(_nothing, "no media file|holds no"), (_junk, "none of the 1 clips can be trained with")],
)
def test_an_empty_or_useless_folder_is_one_error(
    database: UnitDatabase, face_models: FaceModels, tmp_path: Path, fill: Folder, words: str
) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    fill(folder)
    with pytest.raises(CorpusError, match=words) as error:
        train(database, folder, QUICK, state=tmp_path / "state")
    assert str(folder) in str(error.value) and "\n" not in str(error.value)
    assert not (tmp_path / "state").exists()


def test_a_folder_of_the_databases_own_clips_is_refused(
    database: UnitDatabase, puppet_corpus: Path
) -> None:
    with pytest.raises(CorpusError, match=r"can be trained with.*is part of the database"):
        train(database, puppet_corpus, QUICK)


def test_a_guide_that_the_database_lacks_is_told_before_the_work(
    database: UnitDatabase, unseen: Path
) -> None:
    told: list[str] = []
    with pytest.raises(DatabaseError, match="holds no guide from phonemes"):
        train(
            database,
            unseen,
            replace(QUICK, target=TargetSettings("mixed")),
            progress=lambda stage, done, total: told.append(stage),
        )
    assert told == []
