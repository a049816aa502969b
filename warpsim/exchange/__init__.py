"""Files of other programs: orbits and attitudes, read into records and written from them."""
