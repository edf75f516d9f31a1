"""Study: users whose rules belong to another family than keeping a margin."""
