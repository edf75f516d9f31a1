"""Study: accuracy of the paper's model on demonstrations as people may show them."""
