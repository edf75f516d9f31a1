"""Study: accuracy of models when images, scenes or labels are worse than in training."""
