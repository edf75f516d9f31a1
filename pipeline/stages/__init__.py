"""One module per DVC stage, of the same name: read inputs, call the library, write outputs."""
