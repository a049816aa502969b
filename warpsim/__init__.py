"""warpsim: what space-based infrared sensors see, rendered by GPU kernels.

Names appear here in the order a user meets them. They are imported on first use, so that `import warpsim` stays fast.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from warpsim.version import __version__

if TYPE_CHECKING:
    from warpsim import labels as labels
    from warpsim import paper as paper
    from warpsim import plot as plot
    from warpsim.dataset.recipe import Recipe as Recipe
    from warpsim.dataset.write_dataset import DatasetReport as DatasetReport
    from warpsim.dataset.write_dataset import write_dataset as write_dataset
    from warpsim.detector.electron import ElectronDetector as ElectronDetector
    from warpsim.detector.nei import NeiDetector as NeiDetector
    from warpsim.errors import InputError as InputError
    from warpsim.exchange.read_files import read_attitude as read_attitude
    from warpsim.exchange.read_files import read_ephemeris as read_ephemeris
    from warpsim.exchange.segments import AttitudeSegment as AttitudeSegment
    from warpsim.exchange.segments import EphemerisSegment as EphemerisSegment
    from warpsim.exchange.write import write_aem as write_aem
    from warpsim.exchange.write import write_oem as write_oem
    from warpsim.exchange.write import write_stk_attitude as write_stk_attitude
    from warpsim.exchange.write import write_stk_ephemeris as write_stk_ephemeris
    from warpsim.optics.camera import Camera as Camera
    from warpsim.optics.distortion import Distortion as Distortion
    from warpsim.optics.psf import PsfAiry as PsfAiry
    from warpsim.optics.psf import PsfGaussian as PsfGaussian
    from warpsim.optics.psf import PsfTable as PsfTable
    from warpsim.optics.telescope import Optics as Optics
    from warpsim.orbit.access_constraints import AccessConstraints as AccessConstraints
    from warpsim.orbit.access_constraints import AccessGeometry as AccessGeometry
    from warpsim.orbit.arc import BallisticArc as BallisticArc
    from warpsim.orbit.constellations import ListedSatellites as ListedSatellites
    from warpsim.orbit.constellations import MixedConstellation as MixedConstellation
    from warpsim.orbit.constellations import SeedPattern as SeedPattern
    from warpsim.orbit.elements import KeplerOrbit as KeplerOrbit
    from warpsim.orbit.elements import StateVector as StateVector
    from warpsim.orbit.ephemeris import EphemerisOrbit as EphemerisOrbit
    from warpsim.orbit.ephemeris import EphemerisSatellites as EphemerisSatellites
    from warpsim.orbit.tle import TleOrbit as TleOrbit
    from warpsim.orbit.tle import TleSatellites as TleSatellites
    from warpsim.orbit.walker import Walker as Walker
    from warpsim.output.catalog_file import write_catalog as write_catalog
    from warpsim.output.czml import write_czml as write_czml
    from warpsim.output.fits_cube import read_cube as read_cube
    from warpsim.output.image_files import image_facts as image_facts
    from warpsim.output.image_files import read_image as read_image
    from warpsim.output.image_files import write_counts as write_counts
    from warpsim.output.image_files import write_fits_image as write_fits_image
    from warpsim.output.image_files import write_signal as write_signal
    from warpsim.output.preview import write_preview as write_preview
    from warpsim.output.run import render_to_folder as render_to_folder
    from warpsim.radiometry.band import Band as Band
    from warpsim.radiometry.bands import BANDS as BANDS
    from warpsim.radiometry.bands import band_radiance_w_m2_sr as band_radiance_w_m2_sr
    from warpsim.radiometry.bands import bands as bands
    from warpsim.radiometry.magnitudes import PHYSICS as PHYSICS
    from warpsim.render.deposit import deposit as deposit
    from warpsim.render.frameset import FrameSet as FrameSet
    from warpsim.render.light_curves import LightCurves as LightCurves
    from warpsim.render.light_curves import light_curves as light_curves
    from warpsim.render.renderer import Renderer as Renderer
    from warpsim.render.stream import StreamStats as StreamStats
    from warpsim.scene.bands import BandDescription as BandDescription
    from warpsim.scene.groups import Release as Release
    from warpsim.scene.groups import TargetGroup as TargetGroup
    from warpsim.scene.groups import TargetSpec as TargetSpec
    from warpsim.scene.lighting import Lighting as Lighting
    from warpsim.scene.pointing import Bias as Bias
    from warpsim.scene.pointing import Drift as Drift
    from warpsim.scene.pointing import FixedPointing as FixedPointing
    from warpsim.scene.pointing import Jitter as Jitter
    from warpsim.scene.pointing import PointingRow as PointingRow
    from warpsim.scene.pointing import PointingStep as PointingStep
    from warpsim.scene.pointing import SchedulePointing as SchedulePointing
    from warpsim.scene.pointing import Slew as Slew
    from warpsim.scene.pointing import TablePointing as TablePointing
    from warpsim.scene.pointing import TrackPointing as TrackPointing
    from warpsim.scene.scenario import Scenario as Scenario
    from warpsim.scene.scene import Scene as Scene
    from warpsim.scene.scene_files import presets as presets
    from warpsim.scene.sensors import Frames as Frames
    from warpsim.scene.sensors import Sensor as Sensor
    from warpsim.scene.sky import Sky as Sky
    from warpsim.sky.apparent import apparent_direction as apparent_direction
    from warpsim.sky.band_index import BandIndex as BandIndex
    from warpsim.sky.catalog import StarCatalog as StarCatalog
    from warpsim.speed.clock import measure_fps as measure_fps
    from warpsim.target.attitude import Attitude as Attitude
    from warpsim.target.attitude_table import AttitudeTable as AttitudeTable
    from warpsim.target.by_wavelength import ByWavelength as ByWavelength
    from warpsim.target.mesh import Mesh as Mesh
    from warpsim.target.shapes import Cone as Cone
    from warpsim.target.shapes import Cylinder as Cylinder
    from warpsim.target.shapes import Frustum as Frustum
    from warpsim.target.shapes import Plate as Plate
    from warpsim.target.shapes import Sphere as Sphere
    from warpsim.target.surface import Graybody as Graybody
    from warpsim.target.temperature import HeatBalance as HeatBalance
    from warpsim.target.temperature import Temperature as Temperature
    from warpsim.target.temperature import TemperatureTable as TemperatureTable

_HOME = {
    "Scene": "warpsim.scene.scene",
    "Scenario": "warpsim.scene.scenario",
    "Sensor": "warpsim.scene.sensors",
    "Frames": "warpsim.scene.sensors",
    "TargetGroup": "warpsim.scene.groups",
    "TargetSpec": "warpsim.scene.groups",
    "Release": "warpsim.scene.groups",
    "Sky": "warpsim.scene.sky",
    "presets": "warpsim.scene.scene_files",
    "Renderer": "warpsim.render.renderer",
    "FrameSet": "warpsim.render.frameset",
    "StreamStats": "warpsim.render.stream",
    "light_curves": "warpsim.render.light_curves",
    "LightCurves": "warpsim.render.light_curves",
    "render_to_folder": "warpsim.output.run",
    "write_czml": "warpsim.output.czml",
    "read_cube": "warpsim.output.fits_cube",
    "read_image": "warpsim.output.image_files",
    "image_facts": "warpsim.output.image_files",
    "write_counts": "warpsim.output.image_files",
    "write_signal": "warpsim.output.image_files",
    "write_fits_image": "warpsim.output.image_files",
    "write_preview": "warpsim.output.preview",
    "measure_fps": "warpsim.speed.clock",
    "StarCatalog": "warpsim.sky.catalog",
    "write_catalog": "warpsim.output.catalog_file",
    "BandIndex": "warpsim.sky.band_index",
    "apparent_direction": "warpsim.sky.apparent",
    "PHYSICS": "warpsim.radiometry.magnitudes",
    "Band": "warpsim.radiometry.band",
    "BandDescription": "warpsim.scene.bands",
    "BANDS": "warpsim.radiometry.bands",
    "bands": "warpsim.radiometry.bands",
    "band_radiance_w_m2_sr": "warpsim.radiometry.bands",
    "Camera": "warpsim.optics.camera",
    "Distortion": "warpsim.optics.distortion",
    "Optics": "warpsim.optics.telescope",
    "PsfGaussian": "warpsim.optics.psf",
    "PsfAiry": "warpsim.optics.psf",
    "PsfTable": "warpsim.optics.psf",
    "deposit": "warpsim.render.deposit",
    "Sphere": "warpsim.target.shapes",
    "Cylinder": "warpsim.target.shapes",
    "Cone": "warpsim.target.shapes",
    "Frustum": "warpsim.target.shapes",
    "Plate": "warpsim.target.shapes",
    "Mesh": "warpsim.target.mesh",
    "Graybody": "warpsim.target.surface",
    "ByWavelength": "warpsim.target.by_wavelength",
    "Temperature": "warpsim.target.temperature",
    "TemperatureTable": "warpsim.target.temperature",
    "HeatBalance": "warpsim.target.temperature",
    "Attitude": "warpsim.target.attitude",
    "AttitudeTable": "warpsim.target.attitude_table",
    "Walker": "warpsim.orbit.walker",
    "SeedPattern": "warpsim.orbit.constellations",
    "ListedSatellites": "warpsim.orbit.constellations",
    "MixedConstellation": "warpsim.orbit.constellations",
    "TleSatellites": "warpsim.orbit.tle",
    "TleOrbit": "warpsim.orbit.tle",
    "KeplerOrbit": "warpsim.orbit.elements",
    "StateVector": "warpsim.orbit.elements",
    "BallisticArc": "warpsim.orbit.arc",
    "Lighting": "warpsim.scene.lighting",
    "AccessConstraints": "warpsim.orbit.access_constraints",
    "AccessGeometry": "warpsim.orbit.access_constraints",
    "TrackPointing": "warpsim.scene.pointing",
    "FixedPointing": "warpsim.scene.pointing",
    "TablePointing": "warpsim.scene.pointing",
    "PointingRow": "warpsim.scene.pointing",
    "SchedulePointing": "warpsim.scene.pointing",
    "PointingStep": "warpsim.scene.pointing",
    "Slew": "warpsim.scene.pointing",
    "Bias": "warpsim.scene.pointing",
    "Drift": "warpsim.scene.pointing",
    "Jitter": "warpsim.scene.pointing",
    "EphemerisOrbit": "warpsim.orbit.ephemeris",
    "EphemerisSatellites": "warpsim.orbit.ephemeris",
    "read_ephemeris": "warpsim.exchange.read_files",
    "read_attitude": "warpsim.exchange.read_files",
    "EphemerisSegment": "warpsim.exchange.segments",
    "AttitudeSegment": "warpsim.exchange.segments",
    "write_oem": "warpsim.exchange.write",
    "write_stk_ephemeris": "warpsim.exchange.write",
    "write_aem": "warpsim.exchange.write",
    "write_stk_attitude": "warpsim.exchange.write",
    "NeiDetector": "warpsim.detector.nei",
    "ElectronDetector": "warpsim.detector.electron",
    "Recipe": "warpsim.dataset.recipe",
    "write_dataset": "warpsim.dataset.write_dataset",
    "DatasetReport": "warpsim.dataset.write_dataset",
    "InputError": "warpsim.errors",
}

_MODULES = ("labels", "paper", "plot")

__all__ = ["__version__", *_MODULES, *_HOME]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"warpsim.{name}")
    if name not in _HOME:
        raise AttributeError(f"module 'warpsim' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
