"""The style of the page: light and dark, wide and narrow, printed."""

STYLE = """
:root { color-scheme: light dark; --text: #1b1b1b; --soft: #5c5c5c; --line: #d4d4d4; --page: #fff; --card: #f6f6f4;
  --good: #14703f; --doubtful: #8a5600; --bad: #b5211e; --curve: #0063a0; }
@media (prefers-color-scheme: dark) { :root { --text: #e6e6e6; --soft: #a6a6a6; --line: #444; --page: #161616;
  --card: #202020; --good: #5fc48d; --doubtful: #e0a94a; --bad: #ff8a80; --curve: #6cb8ee; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1rem; max-width: 76rem; background: var(--page); color: var(--text);
  font: 16px/1.5 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { margin: .5rem 0 0; line-height: 1.2; }
h2 { margin: 2.2rem 0 .6rem; border-bottom: 1px solid var(--line); }
h3 { margin: 1.2rem 0 .3rem; }
p { margin: .4rem 0; max-width: 75ch; }
.soft, dt, caption, summary { color: var(--soft); }
a { color: var(--curve); }
nav a, .skip { display: inline-block; margin-right: 1rem; }
.skip:not(:focus) { position: absolute; left: -99rem; }
:focus-visible { outline: 3px solid var(--curve); outline-offset: 2px; }
.good { color: var(--good); }
.doubtful { color: var(--doubtful); }
.bad { color: var(--bad); font-weight: 600; white-space: pre-line; }
.verdicts { padding-left: 1.2rem; font-size: 1.05rem; }
.wide { overflow-x: auto; margin: .6rem 0; }
figure { margin: 0; }
img { display: block; width: 100%; min-width: 44rem; height: auto; background: #fff; border-radius: 4px; }
table { border-collapse: collapse; font-size: .9rem; overflow-wrap: break-word; }
caption { text-align: left; padding: .2rem 0; }
th, td { padding: .2rem .8rem .2rem 0; text-align: left; vertical-align: top; border-bottom: 1px solid var(--line);
  max-width: 46ch; }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
dl { display: grid; grid-template-columns: minmax(9rem, max-content) 1fr; gap: .15rem 1rem; margin: .4rem 0; }
dd { margin: 0; }
dd p { margin: 0; max-width: none; }
code { font-family: ui-monospace, monospace; font-size: .9rem; }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 24rem), 1fr)); gap: 1rem; }
.cards figure { background: var(--card); border: 1px solid var(--line); border-radius: 4px; padding: .6rem; }
svg { display: block; width: 100%; height: 6rem; margin: .4rem 0; color: var(--curve); }
.band, .line, .mark { vector-effect: non-scaling-stroke; stroke: currentColor; fill: none; }
.band { fill: currentColor; }
.mark { stroke: var(--soft); stroke-dasharray: 4 3; }
@media (max-width: 40rem) {
  body { font-size: 15px; }
  dl { grid-template-columns: 1fr; }
  dd { margin-bottom: .4rem; }
}
@media print {
  body { max-width: none; font-size: 10pt; }
  nav, .skip { display: none; }
  .wide { overflow: visible; }
  img { min-width: 0; }
  h2, h3 { break-after: avoid; }
  figure, tr { break-inside: avoid; }
}
"""
