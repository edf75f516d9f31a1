"""The pages, one folder each: page.html.j2 has the text; figures.py and tables.py draw what it names."""
