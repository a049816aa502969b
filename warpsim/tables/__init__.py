"""Tables of files, of any subject: delimited text, bytes of a line, FITS, VOTable, ECSV, IPAC, Parquet."""
