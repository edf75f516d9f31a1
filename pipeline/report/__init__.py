"""The report: one folder per page under pages/, with text in its template and numbers from tables by name."""
