"""What stages hand to one another: one module per artefact, its schema, reader and writer."""
