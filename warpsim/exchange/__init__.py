"""Files of other programs: element sets, orbits and attitudes, read into records and written from them."""
