"""Study: counterfactuals."""
