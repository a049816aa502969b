"""Tables of files, whatever they are of: delimited text, bytes of a line, FITS, VOTable, ECSV, IPAC, Parquet."""
