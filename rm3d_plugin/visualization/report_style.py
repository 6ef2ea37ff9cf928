"""How the report page looks: light or dark as the reader prefers, narrow or wide, on paper too."""

STYLE = """\
:root {
  color-scheme: light dark;
  --ground: #ffffff; --ink: #1b1f24; --soft: #57606a; --line: #d0d7de; --tile: #f6f8fa; --link: #0969da;
  --warn: #fff4d6; --warn-ink: #5c3d00; --warn-line: #d9a300;
}
@media (prefers-color-scheme: dark) {
  :root {
    --ground: #12161b; --ink: #e6edf3; --soft: #9aa5b1; --line: #343c46; --tile: #1b2129; --link: #58a6ff;
    --warn: #3a2d05; --warn-ink: #ffe3a3; --warn-line: #a97f00;
  }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
main { max-width: 72rem; margin: 0 auto; padding: 1.5rem 1rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0.5rem 0 1rem; }
h2 { font-size: 1.25rem; margin: 2.5rem 0 0.75rem; border-bottom: 1px solid var(--line); padding-bottom: 0.25rem; }
p { max-width: 46rem; }
.warning {
  background: var(--warn); color: var(--warn-ink);
  border-left: 4px solid var(--warn-line); padding: 0.6rem 0.9rem;
}
.note, .empty { color: var(--soft); }
.tiles {
  display: grid; grid-template-columns: repeat(auto-fit, minmax(10rem, 1fr));
  gap: 0.75rem; margin: 1rem 0;
}
.tiles div { background: var(--tile); border: 1px solid var(--line); border-radius: 6px; padding: 0.6rem 0.8rem; }
.tiles dt { color: var(--soft); font-size: 0.85rem; }
.tiles dd { margin: 0; font-size: 1.2rem; font-weight: 600; overflow-wrap: anywhere; }
.scroll { overflow-x: auto; margin: 0.75rem 0; }
.scroll:focus-visible { outline: 2px solid var(--link); }
table { border-collapse: collapse; font-size: 0.92rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; color: var(--soft); padding: 0.25rem 0; }
th, td { padding: 0.3rem 0.75rem; text-align: left; border-bottom: 1px solid var(--line); vertical-align: top; }
thead th { background: var(--tile); white-space: nowrap; vertical-align: bottom; }
tbody th { font-weight: 500; }
th[scope='colgroup'] { border-left: 1px solid var(--line); }
.number { text-align: right; white-space: nowrap; }
.strong th, .strong td { font-weight: 700; background: var(--tile); }
.charts.small { grid-template-columns: repeat(auto-fit, minmax(min(15rem, 100%), 1fr)); gap: 0.75rem; }
.charts { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(26rem, 100%), 1fr)); gap: 1.5rem; }
figure { margin: 1rem 0; }
figure img { max-width: 100%; height: auto; background: #fff; border: 1px solid var(--line); border-radius: 6px; }
figcaption { color: var(--soft); font-size: 0.92rem; }
.chart figcaption { color: var(--ink); font-weight: 600; }
svg { width: 100%; height: auto; }
svg text { fill: var(--soft); font-size: 12px; font-family: inherit; }
svg .grid { stroke: var(--line); stroke-width: 1; }
svg .axis { stroke: var(--soft); stroke-width: 1; }
svg .mark { stroke: var(--soft); stroke-width: 1; stroke-dasharray: 2 4; opacity: 0.7; }
svg .line { fill: none; stroke-width: 2; stroke-linejoin: round; }
.legend {
  display: flex; flex-wrap: wrap; gap: 0.25rem 1rem; list-style: none;
  margin: 0.25rem 0; padding: 0; font-size: 0.88rem;
}
.swatch {
  display: inline-block; width: 0.9rem; height: 0.9rem;
  border-radius: 3px; margin-right: 0.35rem; vertical-align: -0.1rem;
}
.view canvas {
  display: block; width: 100%; height: min(70vh, 40rem); background: #14181d; border-radius: 6px;
  touch-action: none; cursor: grab;
}
.view canvas:focus-visible { outline: 2px solid var(--link); }
.view .bar { display: flex; flex-wrap: wrap; gap: 0.4rem 1.25rem; align-items: center; margin: 0.5rem 0; }
.view .buttons { display: flex; flex-wrap: wrap; gap: 0.25rem; }
.view button, .view select {
  font: inherit; font-size: 0.88rem; color: var(--ink); background: var(--tile);
  border: 1px solid var(--line); border-radius: 6px; padding: 0.15rem 0.6rem; cursor: pointer;
}
.view button[aria-pressed='true'] { background: var(--link); border-color: var(--link); color: var(--ground); }
.view .legend button { border: 0; background: none; padding: 0; }
.view .off { opacity: 0.4; text-decoration: line-through; }
.view .told { max-width: none; margin: 0.25rem 0; font-size: 0.88rem; color: var(--soft); min-height: 1.5em; }
.view input { vertical-align: middle; }
pre {
  overflow-x: auto; background: var(--tile); border: 1px solid var(--line);
  border-radius: 6px; padding: 0.75rem; font-size: 0.85rem;
}
details summary { cursor: pointer; color: var(--link); }
code { overflow-wrap: anywhere; }
@media print { .scroll { overflow: visible; } }
"""
