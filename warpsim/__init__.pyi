"""The public names: one import each, under the page of the reference (docs/reference) that shows it.

`warpsim/__init__.py` reads them here, in this order, and imports each on first use. Type checkers read them, too.
"""

from warpsim import evaluate as evaluate
from warpsim import jax as jax
from warpsim import labels as labels
from warpsim import paper as paper
from warpsim import plot as plot
from warpsim import stonesoup as stonesoup
from warpsim import torch as torch
from warpsim.version import __version__ as __version__

# scene
from warpsim.scene.scene import Scene as Scene
from warpsim.scene.scenario import Scenario as Scenario
from warpsim.scene.sensors import Sensor as Sensor
from warpsim.scene.sensors import Frames as Frames
from warpsim.scene.groups import TargetGroup as TargetGroup
from warpsim.scene.groups import TargetSpec as TargetSpec
from warpsim.scene.groups import Release as Release
from warpsim.scene.band_descriptions import BandDescription as BandDescription
from warpsim.scene.environment import Sky as Sky
from warpsim.scene.environment import Lighting as Lighting
from warpsim.scene.background_terms import Background as Background
from warpsim.scene.background_terms import StrayLight as StrayLight
from warpsim.scene.scene_files import presets as presets

# rendering
from warpsim.render.renderer import Renderer as Renderer
from warpsim.render.frameset import FrameSet as FrameSet
from warpsim.render.line_of_sight import LineOfSight as LineOfSight
from warpsim.render.frame_stream import FrameStream as FrameStream
from warpsim.render.stream import StreamStats as StreamStats
from warpsim.serving.server import serve as serve
from warpsim.serving.server import FrameServer as FrameServer
from warpsim.live.sources import view as view
from warpsim.live.view import View as View
from warpsim.live.recording import record as record
from warpsim.render.light_curves import light_curves as light_curves
from warpsim.render.light_curves import LightCurves as LightCurves
from warpsim.render.light_curve import LightCurve as LightCurve
from warpsim.measure.curve_fit import fit as fit
from warpsim.measure.curve_fit import Fit as Fit
from warpsim.render.deposit import deposit as deposit
from warpsim.speed.work import measure_fps as measure_fps
from warpsim.measure.detections import detections as detections
from warpsim.measure.photometry import photometry as photometry
from warpsim.measure.triangulation import triangulate as triangulate
from warpsim.measure.paths import earth_fixed as earth_fixed
from warpsim.measure.triangulation import Triangulation as Triangulation

# image_gradients
from warpsim.render.gradients import gradients as gradients
from warpsim.render.likelihood import log_likelihood as log_likelihood
from warpsim.render.likelihood import LogLikelihood as LogLikelihood
from warpsim.render.fisher import fisher as fisher
from warpsim.render.fisher import Fisher as Fisher
from warpsim.render.deposit import deposit_gradient as deposit_gradient
from warpsim.render.deposit import deposit_jacobian as deposit_jacobian
from warpsim.render.deposit import DepositGradient as DepositGradient
from warpsim.render.point_images import JacobianStamps as JacobianStamps

# orbits
from warpsim.orbit.walker import Walker as Walker
from warpsim.orbit.constellations import SeedPattern as SeedPattern
from warpsim.orbit.constellations import ListedSatellites as ListedSatellites
from warpsim.orbit.constellations import MixedConstellation as MixedConstellation
from warpsim.orbit.tle import TleSatellites as TleSatellites
from warpsim.orbit.ephemeris import EphemerisSatellites as EphemerisSatellites
from warpsim.orbit.tle import TleOrbit as TleOrbit
from warpsim.orbit.elements import KeplerOrbit as KeplerOrbit
from warpsim.orbit.elements import StateVector as StateVector
from warpsim.orbit.arc import BallisticArc as BallisticArc
from warpsim.orbit.ephemeris import EphemerisOrbit as EphemerisOrbit
from warpsim.orbit.access_constraints import AccessConstraints as AccessConstraints
from warpsim.orbit.access_constraints import AccessGeometry as AccessGeometry
from warpsim.scene.pointing import TrackPointing as TrackPointing
from warpsim.scene.pointing import FixedPointing as FixedPointing
from warpsim.scene.pointing import SchedulePointing as SchedulePointing
from warpsim.scene.pointing import PointingStep as PointingStep
from warpsim.scene.pointing import Slew as Slew
from warpsim.scene.pointing import TablePointing as TablePointing
from warpsim.scene.pointing import PointingRow as PointingRow
from warpsim.scene.pointing import BodyPointing as BodyPointing
from warpsim.scene.pointing import Bias as Bias
from warpsim.scene.pointing import Drift as Drift
from warpsim.scene.pointing import Jitter as Jitter

# targets
from warpsim.target.shapes import Sphere as Sphere
from warpsim.target.shapes import Cylinder as Cylinder
from warpsim.target.shapes import Cone as Cone
from warpsim.target.shapes import Frustum as Frustum
from warpsim.target.shapes import Plate as Plate
from warpsim.target.mesh import Mesh as Mesh
from warpsim.target.surface import Graybody as Graybody
from warpsim.target.surface import ByWavelength as ByWavelength
from warpsim.target.patches import Patch as Patch
from warpsim.target.temperature import Temperature as Temperature
from warpsim.target.temperature import TemperatureTable as TemperatureTable
from warpsim.target.temperature import HeatBalance as HeatBalance
from warpsim.target.attitude import Attitude as Attitude
from warpsim.target.attitude_table import AttitudeTable as AttitudeTable
from warpsim.target.torque_free import TorqueFree as TorqueFree

# optics
from warpsim.optics.camera import Camera as Camera
from warpsim.optics.distortion import Distortion as Distortion
from warpsim.optics.telescope import Optics as Optics
from warpsim.optics.psf import PsfGaussian as PsfGaussian
from warpsim.optics.psf import PsfAiry as PsfAiry
from warpsim.optics.psf import PsfTable as PsfTable
from warpsim.detector.detectors import NeiDetector as NeiDetector
from warpsim.detector.detectors import ElectronDetector as ElectronDetector
from warpsim.detector.hits_and_flicker import RadiationHits as RadiationHits
from warpsim.detector.hits_and_flicker import Flicker as Flicker

# stars
from warpsim.sky.catalog import StarCatalog as StarCatalog
from warpsim.sky.band_index import BandIndex as BandIndex
from warpsim.sky.apparent import apparent_direction as apparent_direction
from warpsim.radiometry.bands import BANDS as BANDS
from warpsim.radiometry.band import Band as Band
from warpsim.radiometry.magnitudes import PHYSICS as PHYSICS
from warpsim.radiometry.bands import band_radiance_w_m2_sr as band_radiance_w_m2_sr

# bands
from warpsim.radiometry.bands import bands as bands

# files
from warpsim.output.run import render_to_folder as render_to_folder
from warpsim.output.calibration import calibrate as calibrate
from warpsim.output.image_files import ccddata as ccddata
from warpsim.output.fits_images import read_cube as read_cube
from warpsim.output.image_files import read_image as read_image
from warpsim.output.image_files import image_facts as image_facts
from warpsim.output.image_files import write_counts as write_counts
from warpsim.output.image_files import write_signal as write_signal
from warpsim.output.image_files import write_fits_image as write_fits_image
from warpsim.output.grey import write_preview as write_preview
from warpsim.output.czml import write_czml as write_czml
from warpsim.output.star_catalogs import write_catalog as write_catalog
from warpsim.exchange.read_files import read_ephemeris as read_ephemeris
from warpsim.exchange.read_files import read_attitude as read_attitude
from warpsim.exchange.segments import EphemerisSegment as EphemerisSegment
from warpsim.exchange.segments import AttitudeSegment as AttitudeSegment
from warpsim.exchange.write import write_oem as write_oem
from warpsim.exchange.write import write_stk_ephemeris as write_stk_ephemeris
from warpsim.exchange.write import write_aem as write_aem
from warpsim.exchange.write import write_stk_attitude as write_stk_attitude
from warpsim.exchange.tdm import write_tdm as write_tdm

# datasets
from warpsim.dataset.write_dataset import write_dataset as write_dataset
from warpsim.dataset.recipe import Recipe as Recipe
from warpsim.dataset.write_dataset import DatasetReport as DatasetReport
from warpsim.dataset.read_dataset import rebuild_sequence as rebuild_sequence
from warpsim.dataset.export import export_dataset as export_dataset
from warpsim.dataset.export import ExportReport as ExportReport

# plot
from warpsim.errors import InputError as InputError
