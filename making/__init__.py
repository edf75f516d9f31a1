"""Make what the project starts from: data/, rendered/pictures/ and the weights of the segmenter. No stage runs it."""
