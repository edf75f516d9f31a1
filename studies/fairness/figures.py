"""Draw nothing: the page consists of tables and charts of its template."""
