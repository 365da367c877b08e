"""Records of seismographs and geophone lines, in the formats that instruments write."""
