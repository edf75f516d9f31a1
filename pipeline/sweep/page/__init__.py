"""The page of a sweep: template, figures and tables."""
