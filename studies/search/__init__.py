"""Study: the same search of settings for every learner, on validation scenes."""
