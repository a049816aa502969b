"""Bars of access over the scene, as a part of a page."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import NamedTuple

from warpsim.plot.figure import plain
from warpsim.scene.scenario import Scenario

MOST_ROWS = 20
"""Of sensors; the shown ones come first."""

_HEIGHT, _GAP, _LEFT, _WIDTH, _RIGHT = 11, 4, 76, 112, 164
_MOST_LETTERS = 30  # of words beside a bar
_NOW, _LIT, _DIM, _TEXT = "#ff6b4a", "#009e73", "#35584d", "#bbb"


class _Row(NamedTuple):
    sensor: str
    spans_s: list[tuple[float, float]]


def _rows(scenario: Scenario, shown: Sequence[str]) -> list[_Row]:
    """Sensors that ever have access, the shown ones first."""
    rows = []
    for instrument in scenario.instruments.values():
        access = instrument.access
        for row in sorted(set(access.row.tolist())):
            own = access.row == row
            spans_s = list(zip(access.start_s[own].tolist(), access.end_s[own].tolist(), strict=True))
            rows.append(_Row(instrument.names[row], spans_s))
    return sorted(rows, key=lambda row: row.sensor not in shown)


def access_bars(scenario: Scenario, time_s: float, shown: Sequence[str] = ()) -> str:
    """Return bars of the sensors with access, with begin and end in words, and a line at an instant, as HTML.

    Args:
        scenario: What is shown.
        time_s: The instant [s after the epoch].
        shown: Sensors whose images are shown; they come first, in white.
    """
    duration_s, all_rows = scenario.scene.duration_s, _rows(scenario, shown)
    rows = all_rows[:MOST_ROWS]
    height = (_HEIGHT + _GAP) * len(rows)
    parts = [part for number, row in enumerate(rows) for part in _drawn(row, number, time_s, duration_s, shown)]
    x = _LEFT + _WIDTH * time_s / duration_s
    parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="0" y2="{height}" stroke="{_NOW}" stroke-width="2"/>')
    for at, anchor, word in ((_LEFT, "middle", "0"), (_LEFT + _WIDTH, "middle", plain(duration_s, 4))):
        parts.append(f'<text x="{at}" y="{height + 9}" text-anchor="{anchor}" fill="#888">{word}</text>')
    n_now = sum(start <= time_s <= end for row in all_rows for start, end in row.spans_s)
    n_more, n_never = len(all_rows) - len(rows), len(scenario.sensor_names) - len(all_rows)
    notes = [f"{n_more} more not drawn"] if n_more else []
    notes += [f"{n_never} of {len(scenario.sensor_names)} sensors never have access"] if n_never else []
    return (
        f'<div class="access" style="padding:0 10px;font:11px sans-serif;color:{_TEXT}">'
        f'Access [s after the epoch]: {n_now} sensors have it now<svg viewBox="0 0 {_LEFT + _WIDTH + _RIGHT} '
        f'{height + 12}" style="width:100%;display:block;margin-top:3px" font-size="10">{"".join(parts)}</svg>'
        f"{'; '.join(notes)}</div>"
    )


def _drawn(row: _Row, number: int, time_s: float, duration_s: float, shown: Sequence[str]) -> list[str]:
    """Name, bars and words of a sensor, as SVG."""
    y = number * (_HEIGHT + _GAP)
    now = any(start <= time_s <= end for start, end in row.spans_s)
    colour = "#fff" if row.sensor in shown else _TEXT
    name = html.escape(row.sensor)
    parts = [f'<text x="{_LEFT - 6}" y="{y + 9}" text-anchor="end" fill="{colour}">{name}</text>']
    for start, end in row.spans_s:
        x, width = _LEFT + _WIDTH * start / duration_s, max(_WIDTH * (end - start) / duration_s, 1.0)
        fill = _LIT if now else _DIM
        parts.append(f'<rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{_HEIGHT}" fill="{fill}"/>')
    words, shade = _words(row, time_s), colour if now else "#888"
    whole = ", ".join(_span(*span) for span in row.spans_s)
    parts.append(f'<text x="{_LEFT + _WIDTH + 6}" y="{y + 9}" fill="{shade}">{words}<title>{whole}</title></text>')
    return parts


def _span(start_s: float, end_s: float) -> str:
    return f"{plain(start_s, 4)} to {plain(end_s, 4)} s"


def _words(row: _Row, time_s: float) -> str:
    """When a sensor has access; where that does not fit, the time of now or next."""
    words = ", ".join(_span(*span) for span in row.spans_s)
    if len(words) <= _MOST_LETTERS:
        return words
    coming = [span for span in row.spans_s if span[1] >= time_s] or row.spans_s[-1:]
    return f"{_span(*coming[0])} and {len(row.spans_s) - 1} more"


def access_note(scenario: Scenario, sensor: str, time_s: float) -> tuple[str, bool]:
    """Return until when a sensor has access, or since and until when it has none, and whether it has access."""
    instrument = scenario.instrument_of(sensor)
    access = instrument.access
    own = access.row == instrument.index(sensor)
    start_s, end_s = access.start_s[own], access.end_s[own]
    now = (start_s <= time_s) & (time_s <= end_s)
    if now.any():
        return f"access until {plain(end_s[now].max(), 4)} s", True
    if not len(start_s):
        return "never has access", False
    before, after = end_s[end_s < time_s], start_s[start_s > time_s]
    parts = [f"lost at {plain(before.max(), 4)} s"] if len(before) else []
    parts += [f"{'again' if len(before) else 'first'} at {plain(after.min(), 4)} s" if len(after) else "not again"]
    return f"no access: {', '.join(parts)}", False
