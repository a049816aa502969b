"""Files: FITS cubes, tables, figures, manifests."""
