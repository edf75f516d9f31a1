"""Statistics as pure functions of arrays: crossed means, tests, scores, conformal selection."""
