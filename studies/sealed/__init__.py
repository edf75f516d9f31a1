"""Study: the paper's model, given every chance; it draws on the results of three other studies."""
