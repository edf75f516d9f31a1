"""Tables, figures and the page a reader opens."""
