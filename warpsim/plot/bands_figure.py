"""Figure of spectral bands: their responses, over the spectra of stars, targets and the Earth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.plot.figure import BLUE, GREEN, GREY, ORANGE, PURPLE, SERIES, VERMILION, new_axes
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import planck_w_m2_sr_um
from warpsim.radiometry.sun_and_earth import earth_spectrum, solar_spectrum
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of
from warpsim.sky.stellar_templates import GIANT, template_temperature_k, template_wavelength_um, templates

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

RANGE_UM = (0.3, 30.0)
DECADES = 4
"""Below its peak, to which a spectrum is drawn."""

GIANT_K = 4000.0
"""Temperature of the star that is drawn besides the Sun."""

_N_WAVELENGTH = 1200
_MOST_SURFACES = 3


def plot_bands(scene: Scene | Scenario, ax: Axes | None = None) -> Axes:
    """Draw the responses of a scene's bands, over the spectra of what its sensors see.

    Responses count on the left axis, by energy or by photon as they were given. Spectra are powers per logarithm of
    wavelength, each relative to its largest in the figure, on the right axis: the Sun and a red giant, the Earth's mean
    emission and the sunlight that it reflects, and for up to three descriptions of targets their own emission at the
    first temperature and the sunlight that they reflect.

    Args:
        scene: The scene.
        ax: Where to draw.

    Raises:
        InputError: The scene has no scenario, or matplotlib is not installed.
    """
    scenario = scenario_of(scene)
    ax = ax or new_axes(10.0, 5.2)
    _draw_responses(ax, scenario.bands)
    spectra = ax.twinx()
    wavelength_um = np.geomspace(*RANGE_UM, _N_WAVELENGTH)
    for label, style, values in [*_background(wavelength_um), *_targets(scenario, wavelength_um)]:
        power = values * wavelength_um
        spectra.plot(wavelength_um, power / power.max(), label=label, linewidth=1.3, **style)
    spectra.set(yscale="log", ylim=(10.0**-DECADES, 20.0), ylabel="power per ln(wavelength) over peak (lines)")
    spectra.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=4, fontsize=8, frameon=False)
    ax.set_title(f"Bands of {scenario.scene.name}")
    return ax


def _draw_responses(ax: Axes, bands: dict[str, Band]) -> None:
    """Draw each response as an area with the band's name at its peak."""
    from matplotlib.ticker import ScalarFormatter

    for number, (name, band) in enumerate(bands.items()):
        colour = SERIES[number % len(SERIES)]
        edge_um = np.concatenate([band.wavelength_um[:1], band.wavelength_um, band.wavelength_um[-1:]])
        ax.fill_between(edge_um, np.pad(band.response, 1), color=colour, alpha=0.25, linewidth=0)
        ax.plot(edge_um, np.pad(band.response, 1), color=colour, linewidth=1.0)
        low_um, high_um = band.half_power_um
        middle = np.log(np.sqrt(low_um * high_um) / RANGE_UM[0]) / np.log(RANGE_UM[1] / RANGE_UM[0])
        above = (middle, 0.90 + 0.045 * (number % 2))
        ax.annotate(name, above, xycoords="axes fraction", ha="center", fontsize=9, color=colour)
    ax.set(xscale="log", xlim=RANGE_UM, ylim=(0.0, 1.3))
    ax.set(xlabel="wavelength [um]", ylabel="response over its peak (areas)")
    ax.set_xticks([0.3, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 30.0])
    ax.xaxis.set_major_formatter(ScalarFormatter())
    ax.minorticks_off()
    ax.grid(axis="x", alpha=0.3)


def _background(wavelength_um: Array) -> list[tuple[str, dict[str, Any], Array]]:
    """Label, style and spectrum per wavelength of the Sun, a star and the Earth."""
    sun, earth = solar_spectrum().at(wavelength_um), earth_spectrum()
    node = int(np.argmin(np.abs(template_temperature_k() - GIANT_K)))
    giant = np.interp(wavelength_um, template_wavelength_um(), templates()[GIANT, node])
    emitted = earth.radiance_w_m2_sr_um(wavelength_um)
    return [
        ("Sun", {"color": ORANGE}, sun),
        (f"giant, {template_temperature_k()[node]:.0f} K", {"color": VERMILION}, giant),
        ("Earth, emitted", {"color": BLUE}, emitted),
        ("Earth, reflected sunlight", {"color": BLUE, "linestyle": ":"}, sun * earth.albedo.at(wavelength_um)),
    ]


def _targets(scenario: Scenario, wavelength_um: Array) -> list[tuple[str, dict[str, Any], Array]]:
    """Label, style and spectrum per wavelength of light from targets, emitted and reflected."""
    sun, lines = solar_spectrum().at(wavelength_um), []
    alike: dict[tuple[Any, int], dict[str, float]] = {}  # names and temperatures by what is drawn as one line
    for target, rows in zip(scenario.targets, scenario.temperatures, strict=True):
        kelvin = float(rows.temperature_k[0])
        alike.setdefault((target.spec.surface, round(kelvin)), {}).setdefault(target.spec.name, kelvin)
    for number, ((surface, _), named) in enumerate(list(alike.items())[:_MOST_SURFACES]):
        kelvin, label = next(iter(named.values())), ", ".join(named)
        emissivity = np.ones_like(wavelength_um)
        if surface.is_spectral:
            emissivity = surface.emissivity_curve.at(wavelength_um)
        colour = (GREEN, PURPLE, GREY)[number]
        emitted = emissivity * planck_w_m2_sr_um(wavelength_um, kelvin)
        lines.append((f"{label}, {kelvin:.0f} K", {"color": colour}, emitted))
        if surface.is_spectral:
            reflected = (1.0 - emissivity) * sun
            lines.append((f"{label}, reflected", {"color": colour, "linestyle": ":"}, reflected))
    return lines
