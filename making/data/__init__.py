"""Draw data/: kitchenware seen from above, table tops, and their catalogue (`python -m making.data`)."""
