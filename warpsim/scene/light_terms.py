"""Terms of the targets' brightness that a scene needs: bounds over all of it, against the sensor's noise."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from warpsim.arrays import F64
from warpsim.constants import ASTRONOMICAL_UNIT_M, EARTH_EQUATORIAL_RADIUS_M
from warpsim.orbit.sun import sunlit_depth
from warpsim.orbit.track import Track
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import band_radiance_w_m2_sr
from warpsim.scene.environment import Lighting
from warpsim.scene.targets import SceneTarget
from warpsim.scene.tracks import Tracks
from warpsim.target.surface import Light

TERMS: tuple[Light, ...] = ("sun", "earth", "albedo")
"""Terms of reflected light, besides the target's own."""

_SURELY_DARK_SUNS = -3.0
"""Depth in the Earth's shadow at nodes, in widths of the Sun, from which no target gets out of it between them."""

_NEAR_TERMINATOR_RAD = 0.02
"""How far sunlit ground may be beyond the horizon at a node and come into view between nodes: 130 km."""

_LIGHT_TIME = 1e-4
"""Change of a distance during the light time, as a fraction of it, at most: v / c."""


@dataclass(frozen=True)
class LightTerm:
    """Presence of a term in the scene's light, with the reason."""

    name: str
    """sun, earth or albedo."""
    kept: bool
    bound_nei: float
    """No target of the scene is brighter by this term in any band, view and frame [NEI]."""
    reason: str
    """One line for people."""


def light_terms(
    lighting: Lighting,
    tracks: Tracks,
    targets: Sequence[SceneTarget],
    satellites: Sequence[int],
    nei_w_cm2: Mapping[Band, float],
) -> dict[str, LightTerm]:
    """Decide which terms to include, the same for all frames and bands of a kind of sensor."""
    near_m = _nearest_m(tracks, targets, satellites)
    bounds = {} if near_m <= 0.0 else _bounds_nei(lighting, tracks, targets, nei_w_cm2, near_m)
    terms: dict[str, LightTerm] = {}
    for name in TERMS:
        bound = bounds.get(name, np.inf)
        if not getattr(lighting, name):
            kept, reason = False, "off"
        elif dark := _why_dark(tracks, name):
            kept, bound, reason = False, 0.0, dark
        elif bound <= lighting.leave_out_nei:
            kept, reason = False, f"left out: at most {bound:.2g} NEI"
        else:
            most = f"up to {bound:.2g} NEI" if np.isfinite(bound) else "targets may come as near as they like"
            kept, reason = True, f"kept: {most}"
        terms[name] = LightTerm(name, kept, float(bound), reason)
    return terms


def _nearest_m(tracks: Tracks, targets: Sequence[SceneTarget], satellites: Sequence[int]) -> float:
    """Lower bound of the distance from sensors to targets, 0 if there is none [m]."""
    nearest = np.inf
    for _, members in itertools.groupby(range(len(targets)), key=lambda target: int(tracks.carrier[target])):
        rows = [tracks.targets[target] for target in members]
        # The distance changes between nodes by half a step's motion at most, accelerations included by the factor.
        apart_m = max(float(np.linalg.norm(_apart(row, rows[0])[0], axis=1).max()) for row in rows)
        for satellite in satellites:
            sensor = tracks.satellites[satellite]
            distance_m, speed_m_s = (np.linalg.norm(vector, axis=1) for vector in _apart(sensor, rows[0]))
            margin_m = 0.5 * min(sensor.step_s, rows[0].step_s) * 1.1 * speed_m_s
            nearest = min(nearest, float((distance_m - margin_m).min()) - apart_m)
    return max(nearest * (1.0 - _LIGHT_TIME), 0.0)


def _apart(one: Track, other: Track) -> tuple[F64, F64]:
    """Position [m] and velocity [m/s] of a body from another, at the nodes of the shorter step, each (n, 3)."""
    finest = min(one, other, key=lambda track: track.step_s)
    (own_m, own_m_s), (other_m, other_m_s) = one.at_nodes_of(finest), other.at_nodes_of(finest)
    return own_m - other_m, own_m_s - other_m_s


def _bounds_nei(
    lighting: Lighting,
    tracks: Tracks,
    targets: Sequence[SceneTarget],
    nei_w_cm2: Mapping[Band, float],
    near_m: float,
) -> dict[str, float]:
    """Largest irradiance of each term [NEI]: incident light times reflectance over the largest projected area."""
    sun_au = np.linalg.norm(tracks.sun.position_m, axis=1).min() / ASTRONOMICAL_UNIT_M - 1e-3
    low_m = min((float(np.linalg.norm(track.position_m, axis=1).min()) for track in tracks.targets), default=np.inf)
    disc = min(EARTH_EQUATORIAL_RADIUS_M / low_m, 1.0) ** 2
    most: dict[str, float] = dict.fromkeys(TERMS, 0.0)
    for band, nei in nei_w_cm2.items():
        sunlight = lighting.sun_w_m2_in(band) / sun_au**2
        heat = np.pi * band_radiance_w_m2_sr(lighting.earth_k_in(band), band)
        falling = {"sun": sunlight, "earth": heat * disc, "albedo": lighting.earth_albedo_in(band) * sunlight * disc}
        for spec in {target.spec for target in targets}:
            # No projection of a convex body is larger than half its surface; facets that hide others count in full.
            largest = 0.5 if getattr(spec.shape, "convex", True) else 1.0
            across_m2 = largest * spec.shape.surface_m2
            for term in TERMS:
                reflectance = max(surface.reflectance_in(band, term) for surface in spec.surfaces)
                irradiance_w_cm2 = falling[term] / np.pi * (reflectance * across_m2) / near_m**2 * 1e-4
                most[term] = max(most[term], irradiance_w_cm2 / nei)
    return most


def _why_dark(tracks: Tracks, name: str) -> str:
    """Reason for no light of a term in the whole scene; empty if there may be some."""
    if name == "earth":
        return ""
    for track in tracks.targets:
        sun_m = tracks.sun.at_nodes_of(track)[0]
        if name == "sun":
            depth = sunlit_depth(track.position_m, sun_m, tracks.pole_icrs)
            illuminated = (depth > _SURELY_DARK_SUNS).any()
        else:
            margin_rad = _terminator_margin_rad(track.position_m, sun_m)
            illuminated = (margin_rad > -_NEAR_TERMINATOR_RAD).any()
        if illuminated:
            return ""
    where = {"sun": "in the Earth's shadow", "albedo": "over the night side"}[name]
    return f"left out: all targets are {where} throughout" if tracks.targets else "left out: there are no targets"


def _terminator_margin_rad(position_m: F64, sun_m: F64) -> F64:
    """Angle by which sunlit ground reaches into the part of the Earth seen from a position [rad]."""
    distance_m = np.linalg.norm(position_m, axis=-1)
    horizon = np.arccos(np.minimum(EARTH_EQUATORIAL_RADIUS_M / distance_m, 1.0))
    cosine = np.einsum("ni,ni->n", position_m, sun_m) / (distance_m * np.linalg.norm(sun_m, axis=-1))
    return np.asarray(np.pi / 2 + horizon - np.arccos(np.clip(cosine, -1.0, 1.0)))
