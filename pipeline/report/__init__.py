"""The report: one folder a page under pages/, words in its template, numbers drawn from tables by name."""
