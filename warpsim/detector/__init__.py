"""From irradiance to counts."""
