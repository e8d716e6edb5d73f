"""The page that explains a selection: what stands on it is what was selected."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from database.cost_definition import FeatureWeights
from database.errors import SelectionError, UnitselError
from database.phonemes import PHONEME_INDEX, PHONEMES
from database.pictures import encode
from database.reader import UnitDatabase, open_database
from database.timing import Timing, WordTrack, write_timing
from database.track import PhonemeTrack
from database.writer import write_database
from unitsel.costs import CostSettings, Weights
from unitsel.explain import explain, write_explanation
from unitsel.explain.facts import path_facts
from unitsel.explain.pictures import CELL, PICTURE_BYTES
from unitsel.explain.strip import FRAMES_A_ROW, MARGIN
from unitsel.guide import guided_costs
from unitsel.likeness.measures import joins, sl_avg, tc_avg, vc_avg
from unitsel.select import Selection, select_path, select_units, target_graph
from unitsel.settings import SelectionSettings, TargetSettings
from unitsel.source import SelectionInput

VOID = {"meta", "br", "hr", "img", "link", "input"}

SETTINGS = SelectionSettings(Weights(2.0, 0.5, 0.3, 0.7), target=TargetSettings("paper"))

Run = Callable[..., tuple[int, str, str]]


class Page(HTMLParser):
    """A page's elements, in order; fails where a tag is not closed as it was opened."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.html = html
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[tuple[str, ...], str]] = []
        self.rows: list[list[str]] = []
        self._open: list[str] = []
        self.feed(html)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        assert len(dict(attrs)) == len(attrs)
        if tag not in VOID:
            self._open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append((tuple(self._open), data))
        if {"td", "th"} & set(self._open):
            self.rows[-1][-1] += data

    def of(self, tag: str, kind: str) -> list[dict[str, str | None]]:
        """Attributes of the elements of a tag and class."""
        return [a for t, a in self.elements if t == tag and kind in (a.get("class") or "").split()]

    def ids(self) -> list[str]:
        return [a["id"] or "" for _, a in self.elements if "id" in a]

    def links(self) -> list[str]:
        names = ("href", "src", "xlink:href", "srcset", "action", "data")
        return [a[n] or "" for _, a in self.elements for n in names if n in a]

    def numbers(self) -> list[dict[str, str]]:
        """The tables of numbers, a row a frame."""
        out, head = [], None
        for row in self.rows:
            if "weighted target" in row:
                head = row
            elif head is not None and len(row) == len(head):
                out.append(dict(zip(head, row, strict=True)))
        return out

    def within(self, tag: str) -> list[str]:
        """Texts that stand directly in a tag."""
        return [text for tags, text in self.texts if tags and tags[-1] == tag]


@pytest.fixture(scope="module")
def database(small_db: Path) -> Iterator[UnitDatabase]:
    with open_database(small_db) as opened:
        yield opened


@pytest.fixture(scope="module")
def track(database: UnitDatabase) -> PhonemeTrack:
    return database.sequence_track(2)


@pytest.fixture(scope="module")
def selection(database: UnitDatabase, track: PhonemeTrack) -> Selection:
    return select_units(database, track, SETTINGS, exclude_sequences=[2])


@pytest.fixture(scope="module")
def page(database: UnitDatabase, track: PhonemeTrack, selection: Selection) -> Page:
    return Page(explain(database, track, selection, SETTINGS))


@pytest.fixture(scope="module")
def joined(database: UnitDatabase, selection: Selection) -> np.ndarray:
    """Frames that a join leads to."""
    units = database.units
    found = joins(units.sequence[selection.units], units.frame[selection.units])
    assert 3 < found.sum() < len(found) - 3
    return np.flatnonzero(found) + 1


def test_page_needs_nothing_else(page: Page) -> None:
    assert page.html.startswith("<!DOCTYPE html>")
    links = page.links()
    assert links and all(link.startswith(("#", "data:image/jpeg;base64,")) for link in links)
    ids = page.ids()
    assert len(set(ids)) == len(ids)
    assert {link[1:] for link in links if link[0] == "#"} <= set(ids)
    assert "script" not in {tag for tag, _ in page.elements}
    assert "http://" not in page.html and "https://" not in page.html
    assert "url(" not in page.html and "@import" not in page.html
    assert "prefers-color-scheme: dark" in page.html


def test_numbers_are_those_of_the_selection(
    database: UnitDatabase, selection: Selection, page: Page
) -> None:
    rows, costs, w = page.numbers(), selection.costs, SETTINGS.weights
    assert [int(r["frame"]) for r in rows] == list(range(len(selection.units)))

    def column(name: str) -> np.ndarray:
        return np.array([float(r[name]) for r in rows])

    def same(name: str, values: np.ndarray) -> None:
        np.testing.assert_allclose(column(name), values, rtol=1e-4, atol=1e-12)

    same("target", costs.target)
    np.testing.assert_allclose(column("paper") + column("lips"), costs.target, rtol=1e-3)
    graph = selection.graph
    assert graph.lips is not None
    for t, (lips, paper, unit) in enumerate(
        zip(graph.lips, graph.paper, selection.units, strict=True)
    ):
        place = int(np.flatnonzero(graph.candidates[t] == unit)[0])
        assert float(rows[t]["paper"]) == pytest.approx(paper[place], rel=1e-4, abs=1e-12)
        asked = 0.0 if lips is None else lips[place]
        assert float(rows[t]["lips"]) == pytest.approx(asked, rel=1e-4, abs=1e-12)
    assert any(lips is not None and lips.max() > 0 for lips in graph.lips)
    same("f", np.append(0, costs.visual))
    same("g", np.append(0, costs.skip))
    same("weighted target", w.target * costs.target)
    same("weighted f", np.append(0, w.concatenation * w.visual * costs.visual))
    same("weighted g", np.append(0, w.concatenation * w.skip * costs.skip))
    same("cheapest", np.array([c.min() for c in selection.graph.target]))
    same("of", np.array([len(c) for c in selection.graph.candidates]))
    for t, (cost, place) in enumerate(zip(costs.target, column("place"), strict=True)):
        assert place == 1 + (selection.graph.target[t] < cost).sum()
    assert column("sum").sum() == pytest.approx(costs.cost, rel=1e-4)
    units, names = database.units, database.sequences.name
    assert [r["clip"] for r in rows] == [names[units.sequence[u]] for u in selection.units]
    assert [int(r["its frame"]) for r in rows] == units.frame[selection.units].tolist()
    assert [r["wanted"] for r in rows] == [PHONEMES[p] for p in selection.graph.phonemes]
    assert [r["recorded"] for r in rows] == [PHONEMES[units.phoneme[u]] for u in selection.units]
    assert "guided" not in rows[0]


def test_summary_adds_up_to_the_path_cost(
    database: UnitDatabase, selection: Selection, page: Page
) -> None:
    rows = {row[0]: row[1:] for row in page.rows if row}
    parts = [float(rows[name][2]) for name in ("target", "visual f", "skip g")]
    cost = float(rows["path cost"][2])
    assert sum(parts) == pytest.approx(cost, rel=1e-4)
    assert cost == pytest.approx(selection.costs.cost, rel=1e-4)
    units = database.units
    place = units.sequence[selection.units], units.frame[selection.units]
    pca = units.pca[selection.units]
    assert float(rows["SL_avg, frames"][0]) == pytest.approx(sl_avg(*place), rel=1e-4)
    assert float(rows["VC_avg"][0]) == pytest.approx(vc_avg(pca, *place), rel=1e-4)
    assert float(rows["TC_avg"][0]) == pytest.approx(tc_avg(selection.costs.target), rel=1e-4)
    assert rows["weights"] == ["target 2, concatenation 0.5"]
    assert rows["lips"] == ["rest 1.5, closure 4"]
    assert "TC_avg: rest and closure of lips" in rows


def test_joins_are_marked_where_they_are(page: Page, joined: np.ndarray) -> None:
    marks = page.of("g", "join")
    assert [m["id"] for m in marks] == [f"j{t}" for t in joined]
    lines = [float(re.match(r"M([\d.]+) ", a["d"] or "")[1]) for a in page.of("path", "line")]
    assert lines == [MARGIN + (t % FRAMES_A_ROW) * CELL for t in joined]
    told = page.of("tr", "joined")
    assert len(told) == len(joined)


def test_worst_come_first(page: Page, selection: Selection, joined: np.ndarray) -> None:
    links = [link for link in page.links() if re.match(r"#[fj]\d", link)]
    costs, w = selection.costs, SETTINGS.weights
    worst = int(costs.target.argmax())
    assert links[0] == f"#f{worst}"
    steps = (w.visual * costs.visual + w.skip * costs.skip)[joined - 1]
    first_join = next(link for link in links if link[1] == "j")
    assert first_join == f"#j{joined[steps.argmax()]}"


def test_each_unit_is_drawn_once_and_shown_where_it_is_used(
    database: UnitDatabase, selection: Selection, page: Page
) -> None:
    images = {a["id"]: a["href"] or "" for tag, a in page.elements if tag == "image"}
    assert set(images) == {f"u{u}" for u in selection.units}
    # Those of the summary stand at the upper edge of a picture of their own.
    used = [a["href"] for tag, a in page.elements if tag == "use" and "y" in a]
    assert used == [f"#u{u}" for u in selection.units]
    for name, data in images.items():
        stored = np.frombuffer(base64.b64decode(data.partition(",")[2]), np.uint8)
        shown = cv2.cvtColor(cv2.imdecode(stored, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
        real = database.picture(int(name[1:]))
        assert shown.shape == real.shape
        assert np.abs(shown.astype(int) - real).mean() < 8


def test_phones_last_as_long_as_they_do(
    database: UnitDatabase, track: PhonemeTrack, page: Page
) -> None:
    shown = 0.0
    place = [i for i, (_, a) in enumerate(page.elements) if a.get("class") == "phone"]
    for i in place:
        rect = next(a for tag, a in page.elements[i:] if tag == "rect")
        shown += float(rect["width"] or 0)
    assert shown == pytest.approx(track.end * database.fps * CELL, rel=1e-3)
    lines = "".join(a["d"] or "" for a in page.of("path", "boundary"))
    drawn = [float(x) for x in re.findall(r"M([\d.]+)", lines)]
    frames = track.boundaries[1:-1] * database.fps
    expected = MARGIN + (frames % FRAMES_A_ROW) * CELL
    assert drawn == pytest.approx(expected[frames % FRAMES_A_ROW > 0.01], abs=0.06)


def _lines(page: Page, kind: str) -> list[dict[float, float]]:
    """Points of the lines of a class, by x, without that of the legend."""
    lines = [(a["points"] or "").split() for a in page.of("polyline", kind)]
    return [{float(x): float(y) for x, y in (p.split(",") for p in line)} for line in lines][1:]


def test_trajectories_are_those_of_the_units(
    database: UnitDatabase, selection: Selection, page: Page
) -> None:
    units = selection.units[:FRAMES_A_ROW]
    centres = [MARGIN + (i + 0.5) * CELL for i in range(len(units))]
    for line, values in zip(
        _lines(page, "selected")[:2],
        (database.units.mouth_height[units], database.units.pca[units, 0]),
        strict=True,
    ):
        drawn = np.array([line[x] for x in centres])
        # Up is more; the picture's y goes down.
        assert np.corrcoef(drawn, values)[0, 1] == pytest.approx(-1, abs=1e-3)
    assert len(_lines(page, "mean")) == len(_lines(page, "selected"))
    assert not page.of("polyline", "predicted")


def _guided(
    database: UnitDatabase, track: PhonemeTrack, settings: SelectionSettings
) -> tuple[Selection, np.ndarray]:
    """Select with a prediction that is a recorded sentence; its units."""
    source = SelectionInput.of(database, settings.costs)
    graph = target_graph(source, track, [2])
    like = np.flatnonzero(database.units.sequence == 2)[: len(graph.phonemes)]
    space = source.space
    predicted = space.features[like]
    guided = tuple(
        guided_costs(mouth, space.features, space.groups, c)
        for mouth, c in zip(predicted, graph.candidates, strict=True)
    )
    graph = replace(graph, predicted=predicted, guided=guided, share=settings.target.guided)
    return select_path(source, graph, settings.weights), like


def test_prediction_and_both_target_costs_are_shown(
    database: UnitDatabase, track: PhonemeTrack
) -> None:
    settings = replace(SETTINGS, target=TargetSettings("mixed", 0.7))
    selection, like = _guided(database, track, settings)
    facts = path_facts(database, selection, settings)
    height, pca = facts.trajectories
    assert height.predicted and pca.predicted
    np.testing.assert_allclose(height.wanted, database.units.mouth_height[like], rtol=1e-4)
    np.testing.assert_allclose(pca.wanted, database.units.pca[like, 0], rtol=1e-3, atol=1e-3)
    page = Page(explain(database, track, selection, settings))
    rows = page.numbers()
    for r in rows:
        mixed = 0.3 * float(r["paper"]) + 0.7 * float(r["guided"])
        assert float(r["target"]) == pytest.approx(mixed, rel=1e-3)
    assert sum(float(r["sum"]) for r in rows) == pytest.approx(selection.costs.cost, rel=1e-4)
    line = _lines(page, "predicted")[0]
    drawn = [line[MARGIN + (i + 0.5) * CELL] for i in range(FRAMES_A_ROW)]
    real = database.units.mouth_height[like[:FRAMES_A_ROW]]
    assert np.corrcoef(drawn, real)[0, 1] == pytest.approx(-1, abs=1e-3)


def test_a_group_without_weight_has_no_prediction(
    database: UnitDatabase, track: PhonemeTrack
) -> None:
    costs = CostSettings(features=FeatureWeights(lips=0.0))
    settings = SelectionSettings(SETTINGS.weights, costs, TargetSettings("mixed", 0.7))
    selection, _ = _guided(database, track, settings)
    height, pca = path_facts(database, selection, settings).trajectories
    assert not height.predicted and pca.predicted


def test_words_lead_to_their_frames_and_names_are_escaped(
    makedb: ModuleType, tmp_path: Path
) -> None:
    nasty = ["<b>&\"'", "a<script>", "ünïcode", "https://example"]
    path = makedb.make_database(tmp_path / "x<y>.h5", sequences=4, names=nasty)
    with open_database(path) as database:
        own = database.sequence_track(0)
        track = PhonemeTrack(own.phonemes, own.boundaries, "</title><i>say & go")
        words = WordTrack(("<u>one", "two&amp;"), (0.5, 1.2), (1.0, 9.0))
        selection = select_units(database, track, SETTINGS)
        html = explain(database, track, selection, SETTINGS, words=words)
    page = Page(html)
    tags = {tag for tag, _ in page.elements}
    assert not tags & {"y", "u", "script"}
    assert [a for tag, a in page.elements if tag == "b"] == [{"id": "cost"}]
    assert "&lt;/title&gt;&lt;i&gt;say &amp; go" in html
    links = [a["href"] for tag, a in page.elements if tag == "a"]
    chips = list(zip(links, page.within("a"), strict=True))
    # 0.5 s is within frame 12, its middle; 1.2 s is the start of frame 30.
    assert chips[:2] == [("#f12", "<u>one"), ("#f30", "two&amp;")]
    after = [i + 2 for i, (_, a) in enumerate(page.elements) if a.get("class") == "word"]
    spans = [page.elements[i][1] for i in after]
    widths = [float(s["width"] or 0) for s in spans]
    length = len(selection.units)
    assert sum(widths) == pytest.approx(((1.0 - 0.5) * 25 + length - 1.2 * 25) * CELL, abs=0.5)
    assert {r["clip"] for r in page.numbers()} <= set(nasty)


def test_fallbacks_are_listed(database: UnitDatabase) -> None:
    said = [PHONEME_INDEX[p] for p in ("sil", "oy", "sil")]
    track = PhonemeTrack(np.array(said), np.array([0.0, 0.4, 0.8, 1.0]))
    selection = select_units(database, track, SETTINGS)
    page = Page(explain(database, track, selection, SETTINGS))
    assert len(selection.fallbacks) == 1
    assert page.within("li") == [str(selection.fallbacks[0])]
    assert len(page.of("text", "other")) == selection.fallbacks[0].frames


def test_one_frame(database: UnitDatabase) -> None:
    track = PhonemeTrack(np.array([PHONEME_INDEX["ae"]]), np.array([0.0, 0.04]))
    selection = select_units(database, track, SETTINGS)
    page = Page(explain(database, track, selection, SETTINGS))
    assert len(page.numbers()) == 1
    assert not page.of("g", "join")
    assert "none: one recorded segment" in page.html


def test_a_minute_is_wrapped_into_rows(database: UnitDatabase) -> None:
    tracks = [database.sequence_track(s % 6) for s in range(20)]
    ends = np.cumsum([t.end for t in tracks])
    bounds = [t.boundaries[1:] + e - t.end for t, e in zip(tracks, ends, strict=True)]
    track = PhonemeTrack(
        np.concatenate([t.phonemes for t in tracks]), np.concatenate([[0.0], *bounds])
    )
    selection = select_units(database, track, SETTINGS)
    n = len(selection.units)
    assert n >= 1495
    page = Page(explain(database, track, selection, SETTINGS))
    assert len(page.of("svg", "row")) == -(-n // FRAMES_A_ROW)
    assert len(page.of("g", "cell")) == n
    widest = {(a["viewbox"] or "").split()[2] for a in page.of("svg", "row")}
    assert widest == {str(MARGIN + FRAMES_A_ROW * CELL + 4)}


def test_three_seconds_of_noise_stay_small(makedb: ModuleType, tmp_path: Path) -> None:
    """Pictures that no codec makes small, larger than any that is shown, at 50 frames a second."""
    content, pictures, landmarks = makedb.make_content(
        sequences=1, frames=150, fps=50.0, crop=(200, 210), missing_in=None
    )
    rng = np.random.default_rng(1)
    noise = (encode(rng.integers(0, 256, p.shape, dtype=np.uint8)) for p in pictures)
    write_database(tmp_path / "noise.h5", content, noise, landmarks, "png")
    with open_database(tmp_path / "noise.h5") as database:
        track = database.sequence_track(0)
        selection = select_units(database, track, SETTINGS)
        assert len(np.unique(selection.units)) > 140
        html = explain(database, track, selection, SETTINGS)
    assert len(html.encode()) < 3_000_000
    images = re.findall(r"base64,([^\"]+)", html)
    assert max(map(len, images)) <= 4 * -(-PICTURE_BYTES // 3)
    assert len(images) == len(np.unique(selection.units))


def test_a_path_of_another_database_is_refused(
    makedb: ModuleType, track: PhonemeTrack, selection: Selection, tmp_path: Path
) -> None:
    path = makedb.make_database(tmp_path / "other.h5", sequences=1)
    with open_database(path) as other, pytest.raises(SelectionError, match="not the database"):
        explain(other, track, selection, SETTINGS)


def test_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    write_explanation(path, "one")
    write_explanation(path, "two \udc80 ü")
    assert path.read_text(encoding="utf-8") == "two ? ü"
    assert [p.name for p in tmp_path.iterdir()] == ["page.html"]
    (tmp_path / "folder.html").mkdir()
    for bad in (tmp_path / "none" / "page.html", tmp_path / "folder.html"):
        with pytest.raises(UnitselError, match=re.escape(str(bad))) as error:
            write_explanation(bad, "three")
        assert "\n" not in str(error.value)
    assert path.read_text(encoding="utf-8") == "two ? ü"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder.html", "page.html"]


@pytest.mark.parametrize("name", ["page.txt", "none/page.html"])
def test_a_page_that_cannot_be_written_is_refused_before_the_work(
    name: str, small_db: Path, track: PhonemeTrack, run: Run, tmp_path: Path
) -> None:
    write_timing(tmp_path / "say.lab", track)
    explained, video = tmp_path / name, tmp_path / "out.mp4"
    status, out, err = run(
        "synth", small_db, tmp_path / "say.lab", "-o", video, "--explain", explained
    )
    assert status != 0 and out == ""
    assert err.startswith(f"unitsel: {explained}: ") and err.count("\n") == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["say.lab"]


def test_synth_writes_the_page(
    puppet: ModuleType, puppet_db: Path, run: Run, tmp_path: Path
) -> None:
    phones, words = puppet.even_track("bin blue", 0.1, 0.7)
    write_timing(tmp_path / "say.TextGrid", Timing(phones, words))
    explained = tmp_path / "page.html"
    command = ("synth", puppet_db, tmp_path / "say.TextGrid", "-o", tmp_path / "out.mp4")
    status, out, err = run(*command, "--target", "paper", "--explain", explained, "--json")
    assert (status, err) == (0, "")
    document = json.loads(out)
    assert document["explanation"] == str(explained)
    page = Page(explained.read_text(encoding="utf-8"))
    assert page.within("a")[:2] == ["bin", "blue"]
    total = sum(float(r["sum"]) for r in page.numbers())
    assert total == pytest.approx(document["cost"], rel=1e-4)
