"""From pixels to positions: what is measured in images."""
