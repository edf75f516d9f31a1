"""Study: how far away does each user want paths to stay from each symbol, by every model and in truth?"""
