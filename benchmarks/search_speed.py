"""How fast the search is beside looking at every pair, and how it grows with the database.

Everything but the last table is made up (synthetic_database.py): units, sentences and target costs
at the size of the paper's larger database. Times are the least of several runs, the search and its
opponent in turns; target costs are given. Run as
``python benchmarks/search_speed.py [--quick] [--database DB.h5]``; the last table, of a real
database's own sentences, needs the second.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

import numba

from unitsel.costs import Weights
from unitsel.search import search

sys.path.insert(0, str(Path(__file__).parent))  # `make bench` leaves a script's folder out

from search_baseline import Baseline
from synthetic_database import FPS, SyntheticDatabase, make_database

T = TypeVar("T")

UNITS, SEQUENCES = 36_358, 180
SETTINGS = ((5.0, 0.36), (1.0, 0.36), (5.0, 0.11), (1.0, 0.11), (0.2, 0.11))
"""J, the weighted penalty of a jump, and s, the standard deviation of the target costs."""
LENGTHS = (150, 1500)


def best_of(runs: int, work: Callable[[], T]) -> tuple[float, T]:
    """Least time of some runs, seconds, and what the last returned."""
    least = float("inf")
    for _ in range(runs):
        started = time.perf_counter()
        result = work()
        least = min(least, time.perf_counter() - started)
    return least, result


def weights_for(database: SyntheticDatabase, jump: float) -> Weights:
    """Weights with which a jump costs `jump` and the median f costs 1."""
    return Weights(1.0, 1.0, 1.0, jump / float(database.space.skip[-1]))


def against_baseline(database: SyntheticDatabase, quick: bool) -> None:
    """Print the first table; ends the program if costs differ."""
    baseline = Baseline(database.space)
    print(f"{len(database.space):,} units; all pairs on one thread and on two, the search on one")
    print(
        f"{'J':>4} {'s':>5} {'frames':>6} {'all pairs 1':>11} {'2 threads':>10} {'search':>10} "
        f"{'ratio':>6} {'RTF':>8} {'costs differ':>13}"
    )
    for length in LENGTHS[: 1 if quick else None]:
        for jump, s in SETTINGS:
            weights = weights_for(database, jump)
            candidates, target = database.sentence(length, s, 1)
            ours = partial(search, database.space, candidates, target, weights)
            pairs = partial(baseline.least_cost, candidates, target, weights)
            taken, _ = best_of(5, ours)
            plain = []
            for threads in (1, 2):
                numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
                seconds, least = best_of(3 if length <= 150 else 1, pairs)
                plain.append(seconds)
            again, found = best_of(5, ours)
            taken = min(taken, again)
            difference = abs(found.cost - least) / least
            # The opponent is whichever was faster: two threads may wait for a busy processor.
            print(
                f"{jump:>4g} {s:>5g} {length:>6} {plain[0] * 1e3:>8.0f} ms {plain[1] * 1e3:>7.0f} "
                f"ms {taken * 1e3:>7.1f} ms {min(plain) / taken:>6.1f} "
                f"{taken * FPS / length:>8.5f} {difference:>13.1e}",
                flush=True,
            )
            if difference > 1e-6:
                sys.exit(f"the search found {found.cost}, all pairs {least}")


def growth(databases: list[SyntheticDatabase]) -> None:
    """Print the second table."""
    print("\nTen times the units, 150 frames; milliseconds")
    print(f"{'J':>4} {'s':>5} " + " ".join(f"{len(d.space):>9,}" for d in databases) + "  ratio")
    for jump, s in SETTINGS:
        times = []
        for database in databases:
            candidates, target = database.sentence(150, s, 1)
            weights = weights_for(database, jump)
            taken, _ = best_of(5, partial(search, database.space, candidates, target, weights))
            times.append(taken * 1e3)
        print(
            f"{jump:>4g} {s:>5g} "
            + " ".join(f"{t:>9.1f}" for t in times)
            + f" {times[-1] / times[0]:>6.1f}",
            flush=True,
        )


def on_database(path: str) -> None:
    """Print the third table: a database's own sentences, each without its own clip."""
    import unitsel
    from unitsel.select import target_graph
    from unitsel.source import SelectionInput

    database = unitsel.open_database(path)
    source = SelectionInput.of(database)
    sentences = range(0, len(database.sequences.name), max(1, len(database.sequences.name) // 10))
    graphs = [target_graph(source, database.sequence_track(s), [s]) for s in sentences]
    print(f"\n{path}: {len(source)} units, {len(graphs)} sentences; seconds a second of video")
    for weights in (Weights(), Weights(visual=0.05, skip=0.01)):
        shares = []
        for graph in graphs:
            taken, _ = best_of(
                3, partial(search, source.space, graph.candidates, graph.target, weights)
            )
            shares.append(taken / graph.duration)
        print(
            f"visual {weights.visual:g} skip {weights.skip:g}: mean {sum(shares) / len(shares):.5f}"
            f", greatest {max(shares):.5f}"
        )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--database", metavar="DB.h5", help="a real database")
    parser.add_argument("--quick", action="store_true", help="short sentences only, no growth")
    arguments = parser.parse_args()
    small = make_database(UNITS, SEQUENCES)
    against_baseline(small, arguments.quick)
    if not arguments.quick:
        growth([small, make_database(10 * UNITS, 10 * SEQUENCES)])
    if arguments.database:
        on_database(arguments.database)


if __name__ == "__main__":
    main()
