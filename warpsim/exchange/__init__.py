"""Files of other programs: element sets, ephemerides, attitudes."""
