"""Files exchanged by stages: one module per artefact with its schema, reader and writer."""
