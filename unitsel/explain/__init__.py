"""A page that shows why a sentence looks as it does: what one looks at when a word goes wrong.

The page is one HTML file that needs nothing else: pictures are inside it, it fetches nothing
and runs no script.
"""

from unitsel.explain.page import explain, write_explanation

__all__ = ["explain", "write_explanation"]
