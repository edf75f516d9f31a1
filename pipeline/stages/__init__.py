"""One module per DVC stage with the same name: read inputs, call the library, write outputs."""
