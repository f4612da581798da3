"""Statistics of the channels of a recording, computed tile by tile: noise, speeds, extremes."""
