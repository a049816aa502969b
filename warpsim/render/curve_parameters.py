"""Parameters of a target's light curve: which there are, what they are in the scene, and sets of them for kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels import light_curve_slopes as kinds
from warpsim_kernels.area_slopes import ACROSS, ALONG, BASE, RADIUS, SIDE, TOP
from warpsim_kernels.light_curve import CurveSet

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.render.target_field import motion_struct
from warpsim.target.areas import body_struct, has_facets
from warpsim.target.attitude import BodyMotion, turns
from warpsim.target.patches import Patch
from warpsim.target.surface import Graybody
from warpsim.target.temperature import Temperature

_ATTITUDE = {
    "spin_rev_s": kinds.SPIN + 1,
    "spin_phase_rev": kinds.SPIN,
    "precession_rev_s": kinds.PRECESSION + 1,
    "precession_phase_rev": kinds.PRECESSION,
    "precession_angle_deg": kinds.ANGLE_DEG,
    "rolling_rev_s": kinds.ROLLING + 1,
    "rolling_phase_rev": kinds.ROLLING,
    "axis_ra_deg": kinds.AXIS_RA_DEG,
    "axis_dec_deg": kinds.AXIS_DEC_DEG,
}
_STRUCT_FIELDS = frozenset(name for name in _ATTITUDE if "_rev" in name)
_LENGTHS = ("radius_m", "height_m", "top_radius_m", "width_m", "length_m")
_TEMPERATURE = {
    "temperature_start_k": kinds.START_K,
    "temperature_end_k": kinds.END_K,
    "temperature_offset_k": kinds.OFFSET_K,
}


@dataclass(frozen=True)
class CurveTarget:
    """What a light curve is of, as far as its parameters go."""

    shape: Any
    attitude: Any
    """A BodyMotion, or another motion, whose parameters are not known here."""
    surface: Graybody
    temperature: Any
    bands: list[str]
    kelvin: tuple[float, float]
    """Temperatures that its radiances are tabulated for."""
    nearest_m: float
    """Shortest range of the curve."""
    phase_s: float
    """Time at which phases count."""
    patches: Sequence[Patch]

    @cached_property
    def reasons(self) -> dict[str, str]:
        """Parameters by name: why they do not act; nothing for those that do."""
        shape = self.shape.kind
        found = dict.fromkeys(_ATTITUDE, "")
        if not isinstance(self.attitude, BodyMotion):
            found = dict.fromkeys(_ATTITUDE, "the attitude is no motion of spin, precession and rolling")
        elif shape == "sphere" and all(p.along == (0.0, 1.0) and not p.shows_spin for p in self.patches):
            found = dict.fromkeys(_ATTITUDE, "a sphere looks the same from all sides")
        elif not (has_facets(self.shape) or any(patch.shows_spin for patch in self.patches)):
            what = f"a {shape} with such patches" if self.patches else f"a {shape}"
            found |= dict.fromkeys(("spin_rev_s", "spin_phase_rev"), f"{what} looks the same however it spins")
        found["scale"] = ""
        for name in _LENGTHS:
            found[name] = "" if hasattr(self.shape, name) and not has_facets(self.shape) else f"a {shape} has none"
            if not found[name] and self.patches:
                found[name] = "patches keep the size that they have in the scene"
        linear = isinstance(self.temperature, Temperature)
        for name in _TEMPERATURE:
            of_linear = name != "temperature_offset_k"
            found[name] = "" if of_linear == linear else f"the temperature is {'' if linear else 'not '}linear in time"
        found["range_offset_m"] = ""
        spectral = "the surface is described by wavelength" if self.surface.is_spectral else ""
        found |= {f"{side}.{band}": spectral for side in ("emissivity", "reflectance") for band in self.bands}
        return found

    def chosen(self, parameters: str | Sequence[str] | None) -> list[str]:
        """Return names of parameters that act, each once; InputError otherwise."""
        acting = ", ".join(name for name, reason in self.reasons.items() if not reason)
        if parameters is None:
            return [name for name in acting.split(", ") if not name.startswith("reflectance.")]
        if not isinstance(parameters, str | Sequence):
            raise InputError("must be a list of names", "parameters", parameters)
        names = [parameters] if isinstance(parameters, str) else list(parameters)
        if not names:
            raise InputError(f"must name at least one of {acting}", "parameters")
        for name in names:
            if name not in self.reasons:
                raise InputError(f"must be among {acting}", "parameters", name)
            if self.reasons[name]:
                raise InputError(f"{name} does not act: {self.reasons[name]}", "parameters")
        same = [name.replace("reflectance.", "emissivity.") for name in names]
        if len(set(same)) < len(names):
            twice = next(name for name in same if same.count(name) > 1)
            raise InputError("must name a parameter once (reflectance is 1 - emissivity)", "parameters", twice)
        return names

    @cached_property
    def own(self) -> dict[str, float]:
        """The scene's values of all parameters that act."""
        motion = self.attitude.attitude if isinstance(self.attitude, BodyMotion) else None
        values: dict[str, Any] = {"scale": 1.0, "range_offset_m": 0.0, "temperature_offset_k": 0.0}
        if motion is not None:
            reference, first, _ = self.attitude.axes
            ra, dec = np.arctan2(reference[1], reference[0]), np.arctan2(reference[2], np.hypot(*reference[:2]))
            north, beside = axes_about(np.atleast_1d(ra), np.atleast_1d(dec))[0, 1:]
            turn = np.arctan2(first @ beside, first @ north) / (2 * np.pi)
            values |= {name: getattr(motion, name) for name in _ATTITUDE if name.endswith("rev_s")}
            values |= {name: getattr(self.attitude, name) for name in ("spin_phase_rev", "rolling_phase_rev")}
            values["precession_angle_deg"] = motion.precession_angle_deg
            values["precession_phase_rev"] = self.attitude.precession_phase_rev + turn
            for name in ("spin", "precession", "rolling"):
                since_rev = turns(values[f"{name}_rev_s"], np.array(self.phase_s))
                values[f"{name}_phase_rev"] = (values[f"{name}_phase_rev"] + since_rev) % 1.0
            values["axis_ra_deg"], values["axis_dec_deg"] = np.degrees([ra, dec])
        if isinstance(self.temperature, Temperature):
            end_k = self.temperature.end_k
            values["temperature_start_k"] = self.temperature.start_k
            values["temperature_end_k"] = self.temperature.start_k if end_k is None else end_k
        for name in self.reasons:
            side, _, band = name.partition(".")
            if name in _LENGTHS:
                values[name] = getattr(self.shape, name, 0.0)
            elif band and not self.surface.is_spectral:
                emissivity = self.surface.emissivity_in(band)
                values[name] = emissivity if side == "emissivity" else 1.0 - emissivity
        return {name: float(values[name]) for name, reason in self.reasons.items() if not reason}

    def bounds(self, name: str) -> tuple[float, float]:
        """Return the lowest and highest value of a parameter."""
        if name in _LENGTHS or name == "scale":
            return (0.0 if name == "top_radius_m" else 1e-9), 1e9
        if name in ("temperature_start_k", "temperature_end_k"):
            return self.kelvin
        if name == "temperature_offset_k":
            return -self.kelvin[0], self.kelvin[1] / 2  # the scene's own are from twice the one to half the other
        if name == "range_offset_m":
            return 1.0 - self.nearest_m, 1e15
        if "." in name:
            return 0.0, 1.0
        return -np.inf, np.inf


def axes_about(ra_rad: F64, dec_rad: F64) -> F64:
    """Fixed axes of motions about directions, (n, 3, 3): rows reference, first (to the north), second (to the west)."""
    (ca, sa), (cd, sd) = (np.cos(ra_rad), np.sin(ra_rad)), (np.cos(dec_rad), np.sin(dec_rad))
    zero = np.zeros_like(ra_rad)
    rows = [[cd * ca, cd * sa, sd], [-sd * ca, -sd * sa, cd], [sa, -ca, zero]]
    return np.moveaxis(np.array(rows), -1, 0)


def body_members(shape: Any, length_m: dict[str, F64]) -> tuple[F64, dict[str, F64]]:
    """Members of the kernels' Body by a shape's lengths, (n, 6), and what each length changes them by."""
    n = len(next(iter(length_m.values())))
    value = np.zeros((n, 6))
    slope = {name: np.zeros((n, 6)) for name in length_m}
    if shape.kind == "sphere":
        value[:, RADIUS], slope["radius_m"][:, RADIUS] = length_m["radius_m"], 1.0
        return value, slope
    if shape.kind == "plate":
        for name, other in (("width_m", "length_m"), ("length_m", "width_m")):
            value[:, [TOP, BASE]] = (length_m["width_m"] * length_m["length_m"])[:, None]
            slope[name][:, [TOP, BASE]] = length_m[other][:, None]
        return value, slope
    base_m, height_m = length_m["radius_m"], length_m["height_m"]
    top_m = length_m.get("top_radius_m", base_m if shape.kind == "cylinder" else np.zeros(n))
    less_m, both_m = base_m - top_m, base_m + top_m
    slant_m = np.hypot(height_m, less_m)
    value[:, TOP], value[:, BASE], value[:, SIDE] = np.pi * top_m**2, np.pi * base_m**2, np.pi * both_m * slant_m
    value[:, ACROSS], value[:, ALONG] = height_m / slant_m, less_m / slant_m
    narrow = np.zeros((n, 6))  # what less_m changes side and normals by
    narrow[:, SIDE] = np.pi * both_m * less_m / slant_m
    narrow[:, ACROSS], narrow[:, ALONG] = -height_m * less_m / slant_m**3, height_m**2 / slant_m**3
    base, top = narrow.copy(), -narrow
    base[:, BASE], top[:, TOP] = 2 * np.pi * base_m, 2 * np.pi * top_m
    base[:, SIDE] += np.pi * slant_m
    top[:, SIDE] += np.pi * slant_m
    slope["radius_m"] = base + top if shape.kind == "cylinder" else base
    slope["height_m"][:, SIDE] = np.pi * both_m * height_m / slant_m
    slope["height_m"][:, ACROSS] = less_m**2 / slant_m**3
    slope["height_m"][:, ALONG] = -height_m * less_m / slant_m**3
    if "top_radius_m" in length_m:
        slope["top_radius_m"] = top
    return value, slope


class ParameterSets:
    """Sets of named parameters of a target, in the form that kernels read."""

    def __init__(self, target: CurveTarget, names: Sequence[str]) -> None:
        self.target, self.names = target, list(names)
        self.values = np.array([target.own[name] for name in names])
        """The scene's values, (n_param,)."""
        self.bounds = np.array([target.bounds(name) for name in names])
        """Lowest and highest value of each, (n_param, 2)."""
        self._lengths = [name for name in _LENGTHS if name in target.own]
        self.signs = np.array([-1.0 if name.startswith("reflectance.") else 1.0 for name in names])
        """What the kernels' derivatives are multiplied by, (n_param,)."""
        self.kind = np.array([self._kind(name) for name in names], dtype=np.int32)
        one: Any = CurveSet()
        first = 1 if has_facets(target.shape) else None  # facets_of puts a single mesh there
        one.body, one.attitude, one.scale = body_struct(target.shape, first), motion_struct(target.attitude), 1.0
        self._record = wp.array([one], dtype=CurveSet, device="cpu").numpy().copy()
        self._optics = np.ones((1, len(target.bands), 2))
        if not target.surface.is_spectral:
            emissivity = np.array([target.surface.emissivity_in(band) for band in target.bands])
            self._optics[0] = np.stack([emissivity, 1.0 - emissivity], axis=-1)

    def _kind(self, name: str) -> int:
        """The kernels' number of a derivative."""
        known = {**_ATTITUDE, **dict.fromkeys(_LENGTHS, kinds.SHAPE), **_TEMPERATURE}
        known |= {"scale": kinds.SCALE, "range_offset_m": kinds.RANGE}
        if "." in name:
            return int(kinds.EMISSIVITY) + self.target.bands.index(name.partition(".")[2])
        if name == "temperature_start_k" and self._is_constant:
            return int(kinds.OFFSET_K)
        return int(known[name])

    @property
    def _is_constant(self) -> bool:
        """Whether the end is as warm as the start, whatever that is."""
        temperature = self.target.temperature
        return temperature.end_k is None and "temperature_end_k" not in self.names

    def checked(self, params: npt.ArrayLike) -> F64:
        """Return sets as an array, (n_set, n_param); InputError where one breaks a bound or is not finite."""
        try:
            sets = np.atleast_2d(np.asarray(params, dtype=np.float64))
        except (TypeError, ValueError):
            raise InputError("must be numbers, (n_param,) or (n_set, n_param)", "params") from None
        if sets.ndim != 2 or sets.shape[1] != len(self.names):
            rule = f"must have shape ({len(self.names)},) or (n_set, {len(self.names)}): {', '.join(self.names)}"
            raise InputError(rule, "params", np.shape(params))
        bad = ~((sets >= self.bounds[:, 0]) & (sets <= self.bounds[:, 1]) & np.isfinite(sets))
        if bad.any():
            row, column = np.argwhere(bad)[0]
            low, high = self.bounds[column]
            rule = f"{self.names[column]} must be from {low:g} to {high:g}" if np.isfinite(low) else "must be finite"
            raise InputError(rule, "params", sets[row, column], "g", row=int(row))
        return sets

    def records(self, sets: F64) -> tuple[npt.NDArray[Any], F64, F64]:
        """Return sets as kernels read them.

        Returns:
            The kernels' CurveSets, (n_set,); emissivity and reflectance, (n_set, n_band, 2); what each parameter
            changes the members of the Body by, (n_set, n_param, 6).
        """
        n_set, given = len(sets), dict(zip(self.names, sets.T, strict=True))
        out = np.repeat(self._record, n_set)
        optics = np.repeat(self._optics, n_set, axis=0)
        shapes = np.zeros((n_set, len(self.names), 6))
        full = {name: given.get(name, np.full(n_set, value)) for name, value in self.target.own.items()}
        out["scale"], out["range_offset_m"] = full["scale"], full["range_offset_m"]
        if "axis_ra_deg" in full:
            self._turn(out["attitude"], full)
        if self._lengths and any(name in given for name in self._lengths):
            members, slope = body_members(self.target.shape, {name: full[name] for name in self._lengths})
            for column, name in enumerate(("radius_m", "top_m2", "base_m2", "side_m2", "side_across", "side_along")):
                if self.target.shape.kind == "sphere" or name != "radius_m":
                    out["body"][name] = members[:, column]
            for name in self._lengths:
                if name in given:
                    shapes[:, self.names.index(name)] = slope[name]
        if "temperature_start_k" in full:
            out["start_k"] = full["temperature_start_k"]
            out["end_k"] = full["temperature_start_k" if self._is_constant else "temperature_end_k"]
        else:
            out["start_k"] = out["end_k"] = full["temperature_offset_k"]
        for name, values in given.items():
            side, _, band = name.partition(".")
            if band:
                emissivity = values if side == "emissivity" else 1.0 - values
                optics[:, self.target.bands.index(band)] = np.stack([emissivity, 1.0 - emissivity], axis=-1)
        return out, optics, shapes

    def _turn(self, attitude: npt.NDArray[Any], full: dict[str, F64]) -> None:
        """Write motions."""
        axes = axes_about(np.radians(full["axis_ra_deg"]), np.radians(full["axis_dec_deg"]))
        for number, name in enumerate(("reference", "first", "second")):
            attitude[name] = axes[:, number]
        attitude["tilt_rad"] = np.radians(full["precession_angle_deg"])
        for name in _ATTITUDE:
            if name in full and name in _STRUCT_FIELDS:
                attitude[name] = full[name]
