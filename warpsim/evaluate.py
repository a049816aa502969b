"""Scores of what was made of images, against their truth: of detections, and of tracks."""

from warpsim.measure.detection_score import DetectionScore as DetectionScore
from warpsim.measure.detection_score import detections as detections
from warpsim.measure.track_score import TrackScore as TrackScore
from warpsim.measure.track_score import tracks as tracks
