"""Study: users whose rules belong to another family than fixed margins."""
