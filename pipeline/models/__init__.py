"""Models of P(valid | image, path) for one user, all with the interface of `base`."""
