"""Bars of access over the scene, as a part of a page."""

from __future__ import annotations

import html
import itertools
from collections.abc import Sequence

from warpsim.plot.figure import plain
from warpsim.scene.scenario import Scenario

MOST_ROWS = 20
"""Of sensors; the shown ones come first."""

_HEIGHT, _GAP, _LEFT, _WIDTH, _RIGHT = 11, 4, 76, 112, 164
_MOST_LETTERS = 30  # of words beside a bar
_NOW, _LIT, _DIM, _TEXT = "#ff6b4a", "#009e73", "#35584d", "#bbb"


Spans = list[tuple[float, float]]


def _spans_s(scenario: Scenario, shown: Sequence[str]) -> dict[str, Spans]:
    """When sensors have access, of those that ever have it, the shown ones first."""
    spans_s: dict[str, Spans] = {}
    for instrument in scenario.instruments.values():
        access = instrument.access
        columns = access.row.tolist(), access.start_s.tolist(), access.end_s.tolist()
        for row, start_s, end_s in sorted(zip(*columns, strict=True)):
            spans_s.setdefault(instrument.names[row], []).append((start_s, end_s))
    return dict(sorted(spans_s.items(), key=lambda item: item[0] not in shown))


def access_bars(scenario: Scenario, time_s: float, shown: Sequence[str] = ()) -> str:
    """Return bars of the sensors with access, with begin and end in words, and a line at an instant, as HTML.

    Args:
        scenario: What is shown.
        time_s: The instant [s after the epoch].
        shown: Sensors whose images are shown; they come first, in white.
    """
    duration_s, spans_s = scenario.scene.duration_s, _spans_s(scenario, shown)
    n_row = min(len(spans_s), MOST_ROWS)
    height = (_HEIGHT + _GAP) * n_row
    parts: list[str] = []
    for number, (sensor, own) in enumerate(itertools.islice(spans_s.items(), n_row)):
        parts += _drawn(sensor, own, number, time_s, duration_s, sensor in shown)
    x = _LEFT + _WIDTH * time_s / duration_s
    parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="0" y2="{height}" stroke="{_NOW}" stroke-width="2"/>')
    for at, anchor, word in ((_LEFT, "middle", "0"), (_LEFT + _WIDTH, "middle", plain(duration_s, 4))):
        parts.append(f'<text x="{at}" y="{height + 9}" text-anchor="{anchor}" fill="#888">{word}</text>')
    n_now = sum(start <= time_s <= end for own in spans_s.values() for start, end in own)
    n_more, n_never = len(spans_s) - n_row, len(scenario.sensor_names) - len(spans_s)
    notes = [f"{n_more} more not drawn"] if n_more else []
    notes += [f"{n_never} of {len(scenario.sensor_names)} sensors never have access"] if n_never else []
    return (
        f'<div class="access" style="padding:0 10px;font:11px sans-serif;color:{_TEXT}">'
        f'Access [s after the epoch]: {n_now} sensors have it now<svg viewBox="0 0 {_LEFT + _WIDTH + _RIGHT} '
        f'{height + 12}" style="width:100%;display:block;margin-top:3px" font-size="10">{"".join(parts)}</svg>'
        f"{'; '.join(notes)}</div>"
    )


def _drawn(sensor: str, spans_s: Spans, number: int, time_s: float, duration_s: float, is_shown: bool) -> list[str]:
    """Name, bars and words of a sensor, as SVG."""
    y, colour = number * (_HEIGHT + _GAP), "#fff" if is_shown else _TEXT
    now = any(start <= time_s <= end for start, end in spans_s)
    parts = [f'<text x="{_LEFT - 6}" y="{y + 9}" text-anchor="end" fill="{colour}">{html.escape(sensor)}</text>']
    for start, end in spans_s:
        x, width = _LEFT + _WIDTH * start / duration_s, max(_WIDTH * (end - start) / duration_s, 1.0)
        fill = _LIT if now else _DIM
        parts.append(f'<rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{_HEIGHT}" fill="{fill}"/>')
    words, shade = _words(spans_s, time_s), colour if now else "#888"
    whole = ", ".join(_span(*span) for span in spans_s)
    parts.append(f'<text x="{_LEFT + _WIDTH + 6}" y="{y + 9}" fill="{shade}">{words}<title>{whole}</title></text>')
    return parts


def _span(start_s: float, end_s: float) -> str:
    return f"{plain(start_s, 4)} to {plain(end_s, 4)} s"


def _words(spans_s: Spans, time_s: float) -> str:
    """When a sensor has access; where that does not fit, the time of now or next."""
    words = ", ".join(_span(*span) for span in spans_s)
    if len(words) <= _MOST_LETTERS:
        return words
    coming = [span for span in spans_s if span[1] >= time_s] or spans_s[-1:]
    return f"{_span(*coming[0])} and {len(spans_s) - 1} more"


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
