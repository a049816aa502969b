"""From a scene to frames: device arrays, stages, order."""
