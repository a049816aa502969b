"""Readers of star catalogs: files to tables, tables of known surveys to catalogs."""
