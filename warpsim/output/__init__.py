"""Files: FITS cubes, tables, pictures, manifests."""
