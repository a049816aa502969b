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

from warpsim.live.shown_images import Mark, ShownImage
from warpsim.output.grey import grey

MOST_PX = 1024
"""Larger images are reduced to at most so many pixels a side, by the brightest of each block."""

_MOST_CLUMPS = 3
_MOST_NAMES = 12
"""More targets than these have boxes without names; the cursor tells them."""

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


def tile_html(image: ShownImage, ceiling_nei: float, overlay: bool, with_counts: bool, note: str = "") -> str:
    """Return a tile: caption, picture with boxes, line for what is under the cursor.

    Args:
        image: What is shown.
        ceiling_nei: Drawn white; the scale is asinh, black is blank sky.
        overlay: Whether boxes and names are drawn.
        with_counts: Whether the counts travel with the picture, for the cursor.
        note: Said in the caption, in another colour.
    """
    n_row, n_col = image.counts.shape
    picture = base64.b64encode(png(grey(image.counts, image.levels, MOST_PX, ceiling_nei))).decode()
    counts = base64.b64encode(image.counts.astype("<u2").tobytes()).decode() if with_counts else ""
    marks = json.dumps([[m.target, round(m.x_px, 2), round(m.y_px, 2), f"{m.snr:.3g}"] for m in image.marks])
    drawn = _overlay(image.marks, n_col, n_row) if overlay else ""
    caption = html.escape(f"{image.sensor}, band {image.band}{_merged_text(image) if overlay else ''}")
    caption += f' <span style="color:#e69f00">{html.escape(note)}</span>' if note else ""
    return (
        f'<div class="tile" data-sensor="{html.escape(image.sensor)}" data-band="{html.escape(image.band)}" '
        'style="font:12px sans-serif"><div>'
        f'<div style="min-height:1.3em">{caption}</div>'
        f'<div style="position:relative;line-height:0;cursor:crosshair" data-w="{n_col}" data-h="{n_row}" '
        f'data-x="{image.corner_px[0]}" data-y="{image.corner_px[1]}" '
        f'data-counts="{counts}" data-marks="{html.escape(marks)}" '
        f'onmousemove="{_script(_UNDER_CURSOR)}" onclick="{_script(_ENLARGE)}">'
        f'<img style="width:100%;image-rendering:pixelated" src="data:image/png;base64,{picture}">{drawn}</div>'
        '<div style="min-height:1.3em;color:#888"></div></div></div>'
    )


def _merged_text(image: ShownImage) -> str:
    """Which targets merge, as many as fit."""
    clumps = [" + ".join(names) for names in sorted(image.merged, key=len)]
    more = f" and {len(clumps) - _MOST_CLUMPS} more groups" if len(clumps) > _MOST_CLUMPS else ""
    return f". Merged: {'; '.join(clumps[:_MOST_CLUMPS])}{more}" if clumps else ""


def _overlay(marks: Sequence[Mark], n_col: int, n_row: int) -> str:
    """Boxes and names of targets; those that merge are red."""
    n_of_clump: dict[int, int] = {}
    for mark in marks:
        n_of_clump[mark.clump] = n_of_clump.get(mark.clump, 0) + 1
    size = n_col / 40
    parts = []
    for mark in marks:
        left, top, width, height = mark.box_px
        colour = "#ff6b4a" if mark.clump >= 0 and n_of_clump[mark.clump] > 1 else "#4fd1ff"
        name = html.escape(mark.target)
        parts.append(
            f'<rect data-target="{name}" x="{left:.3f}" y="{top:.3f}" width="{width:.3f}" height="{height:.3f}" '
            f'fill="none" stroke="{colour}" stroke-width="1" vector-effect="non-scaling-stroke"/>'
        )
        if len(marks) <= _MOST_NAMES:
            x, y = left + width + 0.2 * size, top + 0.8 * size
            parts.append(f'<text x="{x:.2f}" y="{y:.2f}" fill="{colour}" font-size="{size:.2f}">{name}</text>')
    return (
        f'<svg viewBox="0 0 {n_col} {n_row}" preserveAspectRatio="none" '
        f'style="position:absolute;inset:0;width:100%;height:100%;pointer-events:none">{"".join(parts)}</svg>'
    )


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
