"""Deposit and read-out by way of signal in memory, few views at a time: what they hold then stays in the cache."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import warp as wp

from warpsim.launches import Stage
from warpsim.render.batch import Columns, Inputs, copy_views
from warpsim.render.buffers import new_signal, part_of_sources
from warpsim.render.device_scene import DeviceScene
from warpsim.render.schedule import images_at_a_time
from warpsim.render.stages import counts_for, deposit, read_out, read_out_into


@dataclass(frozen=True)
class _Part:
    """The stages that draw and read out views first to end of a pass."""

    first: int
    end: int
    deposit: Stage
    read_out: Stage


class ImageStages:
    """The stages `deposit` and `read_out` of a pass, bound to signal that serves a few of its views at a time.

    Args:
        scene: What the stages read.
        inputs: Of the views of a pass.
        columns: Of the same views.
        sources: Of the same views.
        counts: Of the shape (1, n_band, n_row, n_col); stands in until a pass brings its own.
    """

    def __init__(self, scene: DeviceScene, inputs: Inputs, columns: Columns, sources: Any, counts: wp.array) -> None:
        n_view = len(inputs.frame)
        n_at_a_time = images_at_a_time(scene, n_view)
        self.signal = new_signal((n_at_a_time, *counts.shape[1:]), scene.device)
        self._is_zero = True
        self._parts = []
        for first in range(0, n_view, n_at_a_time):
            end = min(first + n_at_a_time, n_view)
            signal, lists = self.signal.part(end - first), part_of_sources(sources, first, end)
            reads = Inputs(*(array[first:end] for array in vars(inputs).values()))
            drawn = deposit(scene, lists, columns.part(first, end).brightness, signal)
            self._parts.append(_Part(first, end, drawn, read_out(scene, reads, signal, counts, first)))

    def run(
        self, counts: wp.array, kept_w_cm2: wp.array | None, kept_first: int, n_view: int, stream: wp.Stream | None
    ) -> None:
        """Draw and read out the first views of a pass.

        Args:
            counts: Of these views, (n_view, n_band, n_row, n_col); written.
            kept_w_cm2: Where signal is to be kept, of more views, (n, n_band, n_row, n_col); written.
            kept_first: The first of these views there.
            n_view: Views.
            stream: On CUDA.
        """
        signal = self.signal
        if not self._is_zero:  # a pass was broken off
            self._clear(stream)
        self._is_zero = False
        pieces = counts_for(self._parts[0].read_out, counts)
        for part in self._parts:
            n = min(part.end, n_view) - part.first
            if n <= 0:
                break
            part.deposit.run(n, stream)
            if kept_w_cm2 is not None:
                copy_views(kept_w_cm2, kept_first + part.first, signal.images, 0, n, stream)
            read_out_into(part.read_out, pieces)
            part.read_out.run(n, stream)
            copy_views(signal.touched, 0, signal.untouched, 0, n, stream)
        self._is_zero = True

    def _clear(self, stream: wp.Stream | None) -> None:
        """Set all signal to 0, between what the stream did before and what it does next."""
        if stream is not None:
            wp.synchronize_stream(stream)
        self.signal.flat.zero_()
        self.signal.touched.zero_()
        if stream is not None:
            wp.synchronize_stream(wp.get_stream(stream.device))
