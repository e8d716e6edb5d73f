"""How the doctor's page looks: the style of `unitsel.explain`, and what only this page draws."""

from typing import Final

from unitsel.explain.style import STYLE as SHARED

STYLE: Final = (
    SHARED
    + """
:root { --good: #2b8a3e; --thin: #d9a514; --bad: #c92a2a; }
@media (prefers-color-scheme: dark) { :root { --good: #69c77f; --thin: #e8c04a; --bad: #ff6b6b; } }
body { max-width: 1180px; }
h2 { font-size: 18px; margin: 30px 0 6px; border-top: 1px solid var(--line); padding-top: 14px; }
h3 { font-size: 14px; margin: 14px 0 4px; }
ul.findings { list-style: none; padding: 0; margin: 10px 0; }
ul.findings li { margin: 4px 0; padding: 5px 10px; border-left: 5px solid var(--line);
  background: var(--card); border-radius: 3px; max-width: 110ch; }
ul.findings b { display: inline-block; min-width: 5.2em; }
li.good { border-left-color: var(--good) !important; }
li.note { border-left-color: var(--thin) !important; }
li.bad { border-left-color: var(--bad) !important; }
td.text, th.text { text-align: left; white-space: normal; overflow-wrap: anywhere; }
td.bar { min-width: 130px; }
td.bar i { display: inline-block; height: 10px; background: var(--target); border-radius: 2px; }
td.bar i.thin { background: var(--bad); }
svg.map { display: block; width: 100%; max-width: 760px; height: auto; }
svg.map text { font-size: 9px; } svg.map text.row { text-anchor: end; }
rect.have { fill: var(--good); } rect.few { fill: var(--thin); } rect.none { fill: var(--bad); }
rect.have, rect.few { opacity: 0.75; }
i.have { background: var(--good); } i.few { background: var(--thin); }
i.none { background: var(--bad); }
svg.histogram { width: 340px; height: auto; display: block; }
svg.histogram rect.bar { fill: var(--target); } svg.histogram rect.out { fill: var(--bad); }
svg.histogram rect.range, svg.dots rect.range { fill: var(--good); opacity: 0.12; }
svg.dots { width: 100%; max-width: 1100px; height: auto; display: block; }
svg.dots circle { fill: var(--target); } svg.dots circle.out { fill: var(--bad); }
svg text.left { text-anchor: start; } svg text.soft { fill: var(--soft); font-size: 11px; }
svg text.right { text-anchor: end; }
.thumbs { display: flex; flex-wrap: wrap; gap: 12px; margin: 8px 0; }
.thumbs figure { margin: 0; width: 190px; background: var(--card); border-radius: 6px;
  padding: 8px; font-size: 12px; overflow-wrap: anywhere; }
.thumbs img { display: block; max-width: 100%; border-radius: 3px; margin-bottom: 4px; }
code { font-size: 12px; }
"""
)
