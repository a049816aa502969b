"""An image as a part of a web page: a PNG in grey, boxes and names over it, and what is under the cursor."""

from __future__ import annotations

import base64
import html
import json
import struct
import zlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from warpsim.live.shown_images import LEAST_BOX_PX, ShownImage
from warpsim.output.grey import grey

MOST_PX = 1024
"""Larger images are reduced to at most so many pixels a side, by the brightest of each block."""

_MOST_CLUMPS = 3
_MOST_NAMES = 12
"""Of more targets than these only the main ones have names; the cursor tells the others."""

_HALO = 'stroke="#000" stroke-width="3" paint-order="stroke" vector-effect="non-scaling-stroke"'
_TARGET, _MAIN, _MERGED, _ACCESS, _NO_ACCESS = "#4fd1ff", "#f0e442", "#ff6b4a", "#3fd0a0", "#e69f00"

# The cursor's pixel, its counts and the nearest target. Counts come as little-endian 16-bit numbers in base 64.
_UNDER_CURSOR = """
const b=this.getBoundingClientRect(),d=this.dataset,w=+d.w,h=+d.h;
const x=Math.min(w-1,Math.max(0,Math.floor((event.clientX-b.left)/b.width*w)));
const y=Math.min(h-1,Math.max(0,Math.floor((event.clientY-b.top)/b.height*h)));
let t='column '+(x+ +d.x)+', row '+(y+ +d.y);
if(d.counts){if(this.k!==d.counts){this.k=d.counts;this.c=atob(d.counts);}
const i=2*(y*w+x);t+=': '+(this.c.charCodeAt(i)+256*this.c.charCodeAt(i+1))+' counts';}
let n='',r=8;for(const m of JSON.parse(d.marks)){const q=Math.hypot(m[1]-x,m[2]-y);if(q<r){r=q;n=m[0]+', SNR '+m[3];}}
this.nextElementSibling.textContent=n?t+'; '+n:t;
"""

# The tile over the whole page, and back.
_ENLARGE = """
const s=this.closest('.tile').parentElement.style;const on=s.position!=='fixed';
s.cssText=on?'position:fixed;z-index:1000;inset:3vh auto auto 50%;transform:translateX(-50%);'
+'width:min(90vh,90vw);background:#111;padding:8px;border-radius:6px':'';
"""


def legend_html(mains: Sequence[str]) -> str:
    """Return a line that says what the colours of boxes mean, with the names of the main targets."""
    of_main = f"main target ({', '.join(mains[:3])}{', ...' if len(mains) > 3 else ''})"
    parts = [(_TARGET, "target"), *([(_MAIN, of_main)] if mains else []), (_MERGED, "targets that merge")]
    boxes = [
        f'<span style="white-space:nowrap"><span style="display:inline-block;width:8px;height:8px;margin-right:4px;'
        f'border:2px solid {colour}"></span>{html.escape(words)}</span>'
        for colour, words in parts
    ]
    return f'<div class="legend" style="font:12px sans-serif;color:#bbb">{" &nbsp; ".join(boxes)}</div>'


def tile_html(
    image: ShownImage, ceiling_nei: float, overlay: bool, with_counts: bool, note: tuple[str, bool] = ("", True)
) -> str:
    """Return a tile: captions, picture with boxes, line for what is under the cursor.

    Args:
        image: What is shown.
        ceiling_nei: Drawn white; the scale is asinh, black is blank sky.
        overlay: Whether boxes and names are drawn.
        with_counts: Whether the counts travel with the picture, for the cursor.
        note: Said in the caption, of access, and whether there is access now.
    """
    n_row, n_col = image.counts.shape
    picture = base64.b64encode(png(grey(image.counts, image.levels, MOST_PX, ceiling_nei))).decode()
    counts = base64.b64encode(image.counts.astype("<u2").tobytes()).decode() if with_counts else ""
    marks = json.dumps([[m.target, round(m.x_px, 2), round(m.y_px, 2), f"{m.snr:.3g}"] for m in image.marks])
    drawn = _overlay(image) if overlay else ""
    colour = _ACCESS if note[1] else _NO_ACCESS
    caption = f"<b>{html.escape(image.sensor)}</b>, band {html.escape(image.band)}"
    caption += f' <span style="color:{colour}">{html.escape(note[0])}</span>' if note[0] else ""
    merged = "".join(f"<div>{html.escape(line)}</div>" for line in _merged_lines(image))
    return (
        f'<div class="tile" data-sensor="{html.escape(image.sensor)}" data-band="{html.escape(image.band)}" '
        'style="font:12px sans-serif;margin-bottom:10px"><div>'
        f'<div style="min-height:1.3em">{caption}</div>'
        f'<div style="position:relative;line-height:0;cursor:crosshair" data-w="{n_col}" data-h="{n_row}" '
        f'data-x="{image.corner_px[0]}" data-y="{image.corner_px[1]}" '
        f'data-counts="{counts}" data-marks="{html.escape(marks)}" '
        f'onmousemove="{_script(_UNDER_CURSOR)}" onclick="{_script(_ENLARGE)}">'
        f'<img style="width:100%;image-rendering:pixelated" src="data:image/png;base64,{picture}">{drawn}</div>'
        '<div style="min-height:1.3em;color:#888"></div>'
        f'<div class="merged" style="color:{_MERGED}">{merged}</div></div></div>'
    )


def _merged_lines(image: ShownImage) -> list[str]:
    """Which targets merge, as many as fit; the groups of few first."""
    where = f"in {image.sensor}, band {image.band}"
    clumps = [f"{', '.join(names[:-1])} and {names[-1]} merge {where}" for names in sorted(image.merged, key=len)]
    n_more = len(clumps) - _MOST_CLUMPS
    more = [f"{n_more} more {'group' if n_more == 1 else 'groups'} of targets that merge"] if n_more > 0 else []
    return [*clumps[:_MOST_CLUMPS], *more]


def _overlay(image: ShownImage) -> str:
    """Boxes and names of targets; those that merge are red, main ones have thick lines and a word."""
    n_row, n_col = image.counts.shape
    of_merged = {name for names in image.merged for name in names}
    named = {mark.target for mark in image.marks if mark.main or len(image.marks) <= _MOST_NAMES}
    size = n_col / 32
    parts, names = [], []
    for mark in sorted(image.marks, key=lambda mark: mark.main):  # above the others
        left, top, width, height = mark.box_px
        colour = _MERGED if mark.target in of_merged else _MAIN if mark.main else _TARGET
        name = html.escape(mark.target)
        parts.append(
            f'<rect data-target="{name}" x="{left:.3f}" y="{top:.3f}" width="{width:.3f}" height="{height:.3f}" '
            f'fill="none" stroke="{colour}" stroke-width="{2 if mark.main else 1}" vector-effect="non-scaling-stroke"/>'
        )
        if mark.target in named:
            words, colour = (f"{name} (main)", _MAIN) if mark.main else (name, colour)
            names.append(_name(words, (left + width, top), n_col, size, colour))
    return (
        f'<svg viewBox="0 0 {n_col} {n_row}" preserveAspectRatio="none" '
        f'style="position:absolute;inset:0;width:100%;height:100%;pointer-events:none">{"".join(parts + names)}</svg>'
    )


def _name(words: str, corner_px: tuple[float, float], n_col: int, size: float, colour: str) -> str:
    """A name to the right of a box, or before it where it would leave the image."""
    x, y = corner_px[0] + 0.2 * size, corner_px[1] + 0.8 * size
    anchor = ""
    if x + 0.55 * size * len(words) > n_col:
        x, anchor = max(x - LEAST_BOX_PX - 0.4 * size, 0.0), ' text-anchor="end"'
    return f'<text x="{x:.2f}" y="{y:.2f}" fill="{colour}" font-size="{size:.2f}"{anchor} {_HALO}>{words}</text>'


def _script(text: str) -> str:
    """A script within an attribute."""
    return html.escape(text.replace("\n", ""))


def png(image: npt.NDArray[np.uint8]) -> bytes:
    """Return a grey image (row, column) as a PNG of 8 bits, compressed quickly."""
    n_row, n_col = image.shape
    rows = np.zeros((n_row, n_col + 1), np.uint8)  # a row begins with the number of its filter: none
    rows[:, 1:] = image
    header = struct.pack(">IIBBBBB", n_col, n_row, 8, 0, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 1)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in parts
    )
