"""A person's own table: photographs and judged paths in a folder, a report out of it (docs/own-tables.md)."""
