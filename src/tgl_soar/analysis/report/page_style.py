"""How the page of a flight looks: on a desk, on a phone, on paper."""

from __future__ import annotations

from typing import Final

STYLE: Final = """
:root {
  --ink: #1f2429; --soft: #56616b; --rule: #dfe3e7; --paper: #fff; --warn: #d55e00;
  --face: -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif;
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink); font: 16px/1.55 var(--face); }
main { max-width: 60rem; margin: 0 auto; padding: 2.2rem 1.2rem 4rem; }
h1 { font-size: 1.65rem; line-height: 1.2; margin: .1rem 0 .3rem; overflow-wrap: anywhere; }
h2 { font-size: 1.12rem; margin: 0 0 .6rem; }
header p { margin: .1rem 0; color: var(--soft); }
.kind { font-size: .9rem; }
.tiles {
  display: flex; flex-wrap: wrap; gap: .6rem 2.6rem; margin: 1.3rem 0 0; padding: 1rem 0;
  border-top: 2px solid var(--ink); border-bottom: 1px solid var(--rule);
}
.tiles div { display: flex; flex-direction: column; }
.tiles b {
  font-size: 1.35rem; font-weight: 600; line-height: 1.25; font-variant-numeric: tabular-nums;
}
.tiles span { color: var(--soft); font-size: .85rem; }
figure, section, details { margin: 2.6rem 0 0; }
aside {
  margin: 1.4rem 0 0; padding: .7rem 1rem; border-left: 3px solid var(--rule); background: #f7f8f9;
}
aside.lost { border-color: var(--warn); }
aside h2 { font-size: .95rem; margin: 0 0 .2rem; }
aside ul { margin: 0; padding-left: 1.1rem; color: var(--soft); font-size: .92rem; }
figcaption, .small { color: var(--soft); font-size: .9rem; max-width: 48rem; margin: .6rem 0 0; }
.wide { overflow-x: auto; }
.wide > svg { display: block; width: 100%; min-width: 40rem; height: auto; }
table {
  border-collapse: collapse; width: 100%; font-size: .88rem; font-variant-numeric: tabular-nums;
}
th, td {
  padding: .32rem .6rem; text-align: right; border-bottom: 1px solid var(--rule);
  white-space: nowrap;
}
thead th {
  font-weight: 600; color: var(--soft); border-bottom: 1.5px solid var(--ink);
  vertical-align: bottom; white-space: normal; line-height: 1.25;
}
tbody th { font-weight: 600; }
th:first-child { text-align: left; padding-left: 0; }
.words td { text-align: left; white-space: normal; }
.words thead th { text-align: left; }
.words tbody th { font-weight: 400; width: 6rem; }
summary { cursor: pointer; font-weight: 600; }
dl { columns: 14rem; column-gap: 2rem; font-size: .82rem; margin: .8rem 0 0; }
dl div {
  display: flex; justify-content: space-between; break-inside: avoid;
  border-bottom: 1px solid var(--rule);
}
dd { margin: 0; font-variant-numeric: tabular-nums; }
footer {
  margin-top: 3rem; padding-top: .8rem; border-top: 1px solid var(--rule); color: var(--soft);
  font-size: .85rem;
}
@media (max-width: 40rem) {
  main { padding: 1.2rem .9rem 3rem; }
  h1 { font-size: 1.3rem; }
  .tiles { gap: .6rem 1.6rem; }
}
@media print {
  body { font-size: 10.5pt; }
  main { max-width: none; padding: 0; }
  figure, tr, aside { break-inside: avoid; }
  h2 { break-after: avoid; }
  .wide { overflow: visible; }
  .wide > svg { min-width: 0; }
  table { font-size: 8pt; }
  th, td { padding: .2rem .35rem; }
}
"""
