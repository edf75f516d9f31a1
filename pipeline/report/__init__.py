"""The report: a template per page under pages/; its numbers, tables and charts come from tables by name."""
