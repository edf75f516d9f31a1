"""The pages, a folder each: page.html.j2 holds the words, figures.py and tables.py what it asks for by name."""
