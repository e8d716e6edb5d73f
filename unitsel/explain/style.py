"""How the page looks, on light and dark screens."""

from typing import Final

STYLE: Final = """
:root { color-scheme: light dark; --page: #fbfbf9; --ink: #1c1d1f; --soft: #62656b;
  --line: #c9cbd0; --card: #f0f0ec; --target: #4c78a8; --visual: #e0912f; --skip: #b14d8a;
  --join: #c92a2a; --wanted: #2b8a3e; --link: #1a5fb4; --tint: 0.10; }
@media (prefers-color-scheme: dark) { :root { --page: #17181a; --ink: #e8e8e6; --soft: #a2a5ab;
  --line: #45484e; --card: #222427; --target: #6f9fd0; --visual: #eda850; --skip: #d079ae;
  --join: #ff6b6b; --wanted: #69c77f; --link: #8ab8f0; --tint: 0.20; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 16px 20px 60px; max-width: 1700px; background: var(--page);
  color: var(--ink); font: 15px/1.45 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
h1 { font-size: 21px; margin: 0 0 4px; overflow-wrap: anywhere; }
h2 { font-size: 16px; margin: 22px 0 6px; }
a { color: var(--link); }
p { margin: 4px 0; max-width: 110ch; }
.cards { display: flex; flex-wrap: wrap; gap: 12px; margin: 10px 0; align-items: flex-start; }
.card { background: var(--card); border-radius: 6px; padding: 8px 12px; min-width: 0;
  overflow-x: auto; max-width: 100%; }
.card h2 { margin: 0 0 4px; font-size: 14px; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px; }
th, td { padding: 1px 8px; text-align: right; white-space: nowrap; }
th { font-weight: 600; color: var(--soft); vertical-align: bottom; }
th[scope=row], .left td { text-align: left; }
.card td, .card th[scope=row] { vertical-align: middle; }
.numbers tbody tr:nth-child(odd) { background: var(--card); }
.numbers tr.joined td { border-top: 2px solid var(--join); }
.soft, .legend { color: var(--soft); font-size: 13px; }
.said { margin: 8px 0; line-height: 2.5; }
.said a { display: inline-block; line-height: 1.2; padding: 2px 7px; margin: 0 2px;
  border-radius: 4px; color: inherit; text-decoration: none; vertical-align: middle;
  border: 1px solid var(--line); }
.said a:hover { border-color: var(--ink); }
.said small { display: block; font-size: 11px; }
.scroll { overflow-x: auto; margin: 4px 0 0; }
svg.defs { position: absolute; }
svg.row { display: block; width: 100%; min-width: 1120px; height: auto; }
svg.pair { height: 40px; display: block; } svg.single { height: 40px; display: block; }
svg text { font-size: 12px; fill: var(--ink); text-anchor: middle; }
svg text.lane, svg text.tick { text-anchor: end; fill: var(--soft); font-size: 11px; }
svg text.number { fill: var(--soft); font-size: 11px; }
svg text.clipname { fill: #fff; font-size: 11px; }
svg text.same { fill: var(--soft); } svg text.other { fill: var(--join); font-weight: 700; }
.word rect, .phone rect { fill: var(--card); stroke: var(--line); }
.word text { font-weight: 600; }
.tint { fill: hsl(var(--hue) 70% 50% / var(--tint)); } .clip { fill: hsl(var(--hue) 50% 33%); }
rect.target, i.target { fill: var(--target); background: var(--target); }
rect.visual, i.visual { fill: var(--visual); background: var(--visual); }
rect.skip, i.skip { fill: var(--skip); background: var(--skip); }
.axis { stroke: var(--line); fill: none; }
.boundary { stroke: var(--ink); stroke-opacity: 0.45; stroke-dasharray: 2 3; fill: none;
  pointer-events: none; }
polyline { fill: none; stroke-linejoin: round; pointer-events: none; }
polyline.selected { stroke: var(--ink); stroke-width: 2; }
polyline.predicted { stroke: var(--wanted); stroke-width: 2.5; stroke-dasharray: 7 4; }
polyline.mean { stroke: var(--wanted); stroke-width: 1.5; stroke-dasharray: 2 3; }
.join .line { stroke: var(--join); stroke-width: 1.6; fill: none; }
.join .arrow { fill: var(--join); }
.join:target .line { stroke-width: 5; }
.hit { fill: transparent; } .cell:hover .hit { stroke: var(--soft); }
.cell:target .hit { stroke: var(--join); stroke-width: 3; }
.legend i { display: inline-block; width: 12px; height: 12px; margin: 0 4px 0 12px;
  vertical-align: -1px; }
.legend svg { width: 34px; height: 10px; margin: 0 4px 0 12px; vertical-align: 1px; }
summary { cursor: pointer; color: var(--soft); font-size: 13px; }
"""
