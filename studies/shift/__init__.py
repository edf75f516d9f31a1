"""Study: accuracy where images, table tops, items, labels or rules are not those of training."""
