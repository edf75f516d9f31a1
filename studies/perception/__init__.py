"""Study: a segmenter learned without any label of a user, from composites of items on procedural table tops."""
