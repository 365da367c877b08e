"""Recordings of blast seismographs and geophone lines: file formats and checks."""
