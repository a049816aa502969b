"""Errors that name the place, the rule and the value in one line."""

from __future__ import annotations


class InputError(ValueError):
    """Bad input.

    The text is one line: where, rule, value. `scene.toml: camera.fov_deg: must be in (0, 120), got -1.0`
    """
