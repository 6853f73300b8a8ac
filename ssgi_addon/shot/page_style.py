# SPDX-License-Identifier: GPL-3.0-or-later
"""How a shot's page looks, beside what all reports share."""

SHOT_STYLE = """
:root {
  --capture: #1f5fa8; --passes: #e2571f; --denoise: #7d4ea3; --write: #3a8f57; --other: #aab2bb;
  --bad: #b42318; --gap: #e9ecef;
}
ul.facts { list-style: none; padding: 0; margin: 0.5rem 0; font-size: 0.95rem; }
.chart { margin: 1rem 0; }
.chart svg { width: 100%; height: auto; display: block; }
.chart text { font-size: 12px; fill: var(--quiet); font-variant-numeric: tabular-nums; }
.grid { stroke: var(--line); stroke-width: 1; }
.bar { fill: var(--capture); }
.bar.passes { fill: var(--passes); }
.bar.denoise { fill: var(--denoise); }
.bar.write { fill: var(--write); }
.bar.other { fill: var(--other); }
.bar.flicker { fill: var(--denoise); }
.bar.error { fill: var(--accent); }
.bar.known { fill: var(--write); }
path.missing { fill: var(--gap); }
path.failed { fill: #f3c5c0; }
.mark { fill: var(--bad); }
.tip { fill: transparent; }
.tip:hover { fill: rgba(29, 34, 40, 0.08); }
.key { font-weight: 400; font-size: 0.85rem; margin-left: 1rem; }
.key::before {
  content: ""; display: inline-block; width: 0.7rem; height: 0.7rem; margin-right: 0.35rem;
  background: var(--capture);
}
.key.passes::before { background: var(--passes); }
.key.denoise::before { background: var(--denoise); }
.key.write::before { background: var(--write); }
.key.other::before { background: var(--other); }
.only { display: block; margin: 0.5rem 0; font-size: 0.9rem; }
section:has(#only:checked) .cell:not(.marked) { display: none; }
.sheet { display: grid; grid-template-columns: repeat(auto-fill, minmax(11rem, 1fr)); gap: 0.6rem; }
.cell {
  margin: 0; background: var(--wash); border: 1px solid var(--line); display: flex; flex-direction: column;
  content-visibility: auto; contain-intrinsic-size: auto 9rem;
}
.cell img { width: 100%; }
.cell figcaption { font-weight: 400; font-size: 0.78rem; margin: 0; padding: 0.3rem 0.5rem; }
.cell strong { font-size: 0.9rem; margin-right: 0.25rem; }
.cell b {
  display: inline-block; color: #fff; background: var(--bad); border-radius: 0.2rem; padding: 0 0.35rem;
  margin: 0 0 0 0.4rem; font-weight: 600;
}
.cell.marked { outline: 2px solid var(--bad); }
.empty {
  flex: 1; min-height: 5rem; display: grid; place-items: center; text-align: center; overflow: hidden;
  background: repeating-linear-gradient(45deg, #eceff2, #eceff2 8px, #e2e6ea 8px, #e2e6ea 16px);
}
.empty span {
  padding: 0.4rem; font-size: 0.78rem; color: var(--bad); font-weight: 600; overflow-wrap: anywhere;
  display: -webkit-box; -webkit-line-clamp: 4; -webkit-box-orient: vertical; overflow: hidden;
}
main td { overflow-wrap: break-word; }
main th[scope="row"] { white-space: normal; }
"""
