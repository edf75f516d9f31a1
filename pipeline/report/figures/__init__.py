"""One figure a file: arrays and frames in, a matplotlib figure out."""
