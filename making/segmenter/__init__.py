"""Train the segmenter on composites of its own: `make segmenter`."""
