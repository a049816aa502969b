"""Pointing of the sensors of a stream that somebody outside commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import warp as wp
from warpsim_kernels.aim import make_aim_kernel

from warpsim.render.device import kernel_loading
from warpsim.render.pointing_arrays import aim_features
from warpsim.scene.instrument import Instrument
from warpsim.scene.pointing_commands import AppliedCommand, PointingCommand, apply_command, checked_command
from warpsim.scene.scenario import Scenario


class CommandedPointing:
    """Pointing of the sensors of a stream, as commanded so far.

    Args:
        scenario: What the frames are of.
        instrument: The kind of the sensors.
        sensors: Names of those rendered.
        devices: Where they are rendered.
    """

    def __init__(
        self, scenario: Scenario, instrument: Instrument, sensors: Sequence[str], devices: Sequence[wp.Device]
    ) -> None:
        self._scenario, self._own, self._sensors, self._devices = scenario, instrument, sensors, devices
        self.instrument = instrument
        """The kind of the sensors, as it is pointed from now on."""

    def load(self) -> None:
        """Load the kernel of commanded pointing, so that frames need not wait for it."""
        instrument = self._own.commanded(self._own.program, {})
        for device in self._devices:
            loading = kernel_loading(device)
            loading.start(make_aim_kernel(aim_features(instrument)))
            loading.wait()

    def checked(self, command: Any) -> PointingCommand:
        """Return a command once it can be carried out without delay."""
        checked = checked_command(command, self._scenario, self._sensors)
        self.load()
        return checked

    def planned(
        self, command: PointingCommand, before: Instrument, frame: int
    ) -> tuple[Instrument, list[AppliedCommand]]:
        """Return the instrument, as it was before, pointed from a frame on, and what that does."""
        return apply_command(command, self._scenario, before, frame)

    def restart(self) -> None:
        """Point as the scene says."""
        self.instrument = self._own
