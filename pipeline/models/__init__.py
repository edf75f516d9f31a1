"""Models of P(valid | image, path) for one user, behind one interface (`base`)."""
