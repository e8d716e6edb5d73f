"""The cheapest path through the candidates (viterbi.py says how), exactly and fast."""

from unitsel.search.result import SearchResult, priced
from unitsel.search.space import SearchSpace
from unitsel.search.stream import StreamingSearch
from unitsel.search.viterbi import search

__all__ = ["SearchResult", "SearchSpace", "StreamingSearch", "priced", "search"]
